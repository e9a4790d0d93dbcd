//! `isophote show`: a layer of a picture as something to look at.

use std::path::PathBuf;

use anyhow::{Context, Result, ensure};
use clap::Args;
use isophote_scene::{Image, check_writable};

use crate::{output::has_suffix, values};

const EXAMPLES: &str = "\
Examples:
  isophote show hall.exr -o hall.png --exposure 1
  isophote show hall.exr --layer glossy -o glossy.png        one stage of --technique ldi";

/// Show a layer of a picture as sRGB.
#[derive(Args, Debug)]
#[command(after_help = EXAMPLES)]
pub(crate) struct ShowArgs {
    /// A picture: .exr, .hdr or .png
    picture: PathBuf,
    /// A layer with channels R, G and B; those without a name unless given
    #[arg(long, value_name = "NAME", default_value = "")]
    layer: String,
    /// Brighten by this many stops (each doubles the light)
    #[arg(long, value_name = "STOPS", default_value_t = 0.0, value_parser = values::finite, allow_hyphen_values = true)]
    exposure: f32,
    /// The file to write: .png
    #[arg(short, long, value_name = "FILE.png")]
    output: PathBuf,
}

pub(crate) fn show(args: &ShowArgs) -> Result<()> {
    ensure!(
        has_suffix(&args.output, &["png"]),
        "{}: unknown suffix; .png is known",
        args.output.display()
    );
    check_writable(&args.output)?;
    let image = Image::load(&args.picture)?;
    let values = image.rgb(&args.layer).with_context(|| {
        let channels = image.channels.iter();
        let layers: Vec<&str> = channels
            .filter_map(|channel| channel.name.strip_suffix(".R"))
            .collect();
        format!(
            "{}: there is no layer '{}'; there are: {}",
            args.picture.display(),
            args.layer,
            layers.join(", ")
        )
    })?;
    let mut shown = Image::new(image.width, image.height);
    shown.push_layer("", "RGB", &values);
    shown.save_png(&args.output, args.exposure)?;
    Ok(())
}
