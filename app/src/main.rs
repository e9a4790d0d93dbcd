//! The program `isophote`: renders, traces, compares and inspects scenes with every technique.

#![allow(
    rustdoc::broken_intra_doc_links,
    reason = "the comments of arguments are their help texts, in which [metres] is a unit"
)]

mod applies;
mod bake;
mod caster;
mod certify;
mod compare;
mod depth_maps;
mod devices;
mod display;
mod fields;
#[cfg(feature = "gpu")]
mod gpu;
#[cfg(feature = "gpu")]
mod gpu_rays;
mod info;
mod maps;
mod matrix;
mod metrics;
mod npy;
mod output;
mod pairs;
mod picture;
mod rays;
mod reference;
mod render;
mod scene_args;
mod settings;
mod show;
mod technique;
mod trace;
mod tracers;
mod values;
#[cfg(feature = "viewer")]
mod view;

use std::{
    collections::BTreeMap,
    ffi::OsString,
    io::{self, Write},
    path::Path,
    process::ExitCode,
};

use anyhow::{Context, Result, ensure};
use clap::{ArgMatches, Command, CommandFactory, FromArgMatches, Parser, Subcommand};
use isophote_scene::{Image, builtin};

use crate::applies::Idle;

const EXAMPLES: &str = "\
Examples:
  isophote render builtin:cornell -o cornell.png          look at a built-in scene
  isophote info hall.glb                                  what is in a file
  isophote render hall.glb --quantity ao -o ao.exr        calculate ambient occlusion
  isophote bake hall.glb -o baked.glb                     put it into the file
  isophote compare ao.exr reference.exr                   how far off is it

Lengths are metres, angles degrees, light is linear and radiometric. `isophote COMMAND --help` explains every flag. \
RUST_LOG=isophote=debug tells what is loaded, built, computed and written, and how long each took.";

/// Global illumination by any technique over any visibility backend.
#[derive(Parser, Debug)]
#[command(name = "isophote", version, after_help = after_help(), arg_required_else_help = true, args_override_self = true)]
struct Cli {
    #[command(subcommand)]
    command: Commands,
}

fn after_help() -> String {
    let scenes: Vec<String> = builtin::NAMES
        .iter()
        .map(|(name, what)| format!("  {}{name:<10}  {what}", builtin::PREFIX))
        .collect();
    format!("{EXAMPLES}\n\nBuilt-in scenes:\n{}", scenes.join("\n"))
}

#[derive(Subcommand, Debug)]
enum Commands {
    Render(render::RenderArgs),
    Trace(trace::TraceArgs),
    Certify(certify::CertifyArgs),
    Matrix(matrix::MatrixArgs),
    Bake(bake::BakeArgs),
    Compare(compare::CompareArgs),
    Show(show::ShowArgs),
    Info(info::InfoArgs),
    #[cfg(feature = "viewer")]
    View(view::ViewArgs),
    Devices(devices::DevicesArgs),
}

fn main() -> ExitCode {
    start_log();
    match run(std::env::args_os().collect()) {
        Ok(code) => code,
        Err(error) if is_broken_pipe(&error) => ExitCode::SUCCESS,
        Err(error) => {
            let _ = writeln!(io::stderr(), "error: {}", one_line(&whole(&error)));
            ExitCode::from(2)
        }
    }
}

fn run(arguments: Vec<OsString>) -> Result<ExitCode> {
    let command = Cli::command();
    let mut matches = match parse(&command, &arguments) {
        Ok(matches) => matches,
        Err(error) => return refuse(&error),
    };
    if let Some((name, given)) = matches.subcommand()
        && let Some(header) = stored_settings(name, given)?
    {
        let repeated = subcommand(&command, name)?;
        let with = |idle: &[Idle]| {
            let stored = settings::repeat(repeated, given, &header, idle);
            parse(&command, &[&arguments[..], &stored[..]].concat())
        };
        // Which of the stored settings have an effect is only known beside the given ones.
        let all = match with(&[]) {
            Ok(matches) => matches,
            Err(error) => return refuse(&error),
        };
        let idle = match Cli::from_arg_matches(&all)?.command {
            Commands::Render(args) => args.picture.idle(),
            Commands::Bake(args) => args.idle(),
            _ => Vec::new(),
        };
        matches = match with(&idle) {
            Ok(matches) => matches,
            Err(error) => return refuse(&error),
        };
    }
    let cli = Cli::from_arg_matches(&matches)?;
    let (name, given) = matches.subcommand().context("there is no command")?;
    match &cli.command {
        Commands::Render(args) => {
            use_threads(args.threads)?;
            let idle = args.picture.idle();
            applies::refuse(&idle, given)?;
            let stored = settings::store(subcommand(&command, name)?, given, &idle);
            render::render(args, stored)?;
        }
        Commands::Trace(args) => {
            use_threads(args.threads)?;
            trace::trace(args, given)?;
        }
        Commands::Certify(args) => {
            use_threads(args.threads)?;
            certify::certify(args, given)?;
        }
        Commands::Matrix(args) => {
            use_threads(args.threads)?;
            return matrix::matrix(args, given);
        }
        Commands::Bake(args) => {
            use_threads(args.threads)?;
            let idle = args.idle();
            applies::refuse(&idle, given)?;
            let stored = settings::store(subcommand(&command, name)?, given, &idle);
            bake::bake(args, stored)?;
        }
        Commands::Compare(args) => return compare::compare(args),
        Commands::Show(args) => show::show(args)?,
        Commands::Info(args) => info::info(args, given)?,
        #[cfg(feature = "viewer")]
        Commands::View(args) => {
            use_threads(args.threads)?;
            view::view(args, given)?;
        }
        Commands::Devices(args) => devices::devices(args)?,
    }
    Ok(ExitCode::SUCCESS)
}

fn parse(command: &Command, arguments: &[OsString]) -> clap::error::Result<ArgMatches> {
    command.clone().try_get_matches_from(arguments)
}

/// The settings that a command is to repeat, where it is told to: those of a picture, or of the parts of a bake.
fn stored_settings(name: &str, given: &ArgMatches) -> Result<Option<BTreeMap<String, String>>> {
    let path = |id| given.get_one::<std::path::PathBuf>(id);
    match name {
        "render" | "view" => path("settings").map(|path| stored_header(path)).transpose(),
        "bake" => path("merge")
            .map(|path| bake::settings_of_part(path))
            .transpose(),
        _ => Ok(None),
    }
}

/// The settings in a picture's header.
fn stored_header(path: &Path) -> Result<BTreeMap<String, String>> {
    let header = Image::load(path).context("--settings")?.attributes;
    ensure!(
        header.contains_key("technique"),
        "--settings: {}: holds no settings of `isophote render`",
        path.display()
    );
    Ok(header)
}

fn subcommand<'a>(command: &'a Command, name: &str) -> Result<&'a Command> {
    command
        .find_subcommand(name)
        .with_context(|| format!("there is no command '{name}'"))
}

/// Prints help where it was asked for, and everything else as one line.
fn refuse(error: &clap::Error) -> Result<ExitCode> {
    use clap::error::ErrorKind;
    match error.kind() {
        ErrorKind::DisplayHelp
        | ErrorKind::DisplayVersion
        | ErrorKind::DisplayHelpOnMissingArgumentOrSubcommand => {
            error.print()?;
            Ok(ExitCode::from(error.exit_code() as u8))
        }
        _ => anyhow::bail!("{}", told(error)),
    }
}

/// What is wrong with the arguments, in a line.
fn told(error: &clap::Error) -> String {
    let text = error.to_string();
    let told = text.lines().take_while(|line| !line.starts_with("Usage:"));
    let told: Vec<&str> = told
        .filter(|line| !line.starts_with("For more information"))
        .collect();
    let text = one_line(&told.join("\n")).replace(" tip: ", "; ");
    text.strip_prefix("error: ").unwrap_or(&text).to_owned()
}

/// An error with its causes; many an error's text ends with its cause's already.
fn whole(error: &anyhow::Error) -> String {
    let mut text = String::new();
    for cause in error.chain().map(ToString::to_string) {
        if text.is_empty() {
            text = cause;
        } else if !text.contains(&cause) {
            text = format!("{text}: {cause}");
        }
    }
    text
}

fn one_line(text: &str) -> String {
    text.split_whitespace().collect::<Vec<_>>().join(" ")
}

fn use_threads(threads: Option<usize>) -> Result<()> {
    if let Some(threads) = threads {
        rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build_global()
            .context("cannot start the threads")?;
    }
    Ok(())
}

/// Logs go to standard error and are asked for with `RUST_LOG`.
fn start_log() {
    let filter = tracing_subscriber::EnvFilter::builder()
        .with_default_directive(tracing::level_filters::LevelFilter::ERROR.into())
        .from_env_lossy();
    tracing_subscriber::fmt()
        .with_env_filter(filter)
        .with_writer(io::stderr)
        .init();
}

/// Whoever read the output has read enough.
fn is_broken_pipe(error: &anyhow::Error) -> bool {
    error.chain().any(|cause| {
        cause
            .downcast_ref::<io::Error>()
            .is_some_and(|error| error.kind() == io::ErrorKind::BrokenPipe)
    })
}
