//! What must hold of the workspace's shape and no compiler checks.
//!
//! - The dependency rule: a technique depends on `isophote-scene` and `isophote-filters`, never on another technique;
//!   only the application knows them all.
//! - The other half of it: a technique's code names no concrete tracer.
//! - Without its feature `gpu` a crate has no wgpu anywhere in its tree.
//! - Every crate takes the workspace's lints and has a README whose first paragraph says what it is.
//! - Every relative link in the documents leads somewhere.

use std::{fs, path::Path};

use anyhow::{Context, Result, bail};

use crate::workspace::{Package, Workspace, cargo, output, root};

/// The crates that implement one method each.
const TECHNIQUES: [&str; 4] = [
    "isophote-ldi",
    "isophote-ldm-ambient",
    "isophote-displacement-field",
    "isophote-instant-gi",
];

/// Tracers of `isophote-scene` that a technique must take as a `Tracer`, never by name.
const CONCRETE_TRACERS: [&str; 5] = [
    "ComputeBvhTracer",
    "BvhTracer",
    "BruteForceTracer",
    "RayQueryTracer",
    "RayQueryBoxTracer",
];

/// Documents of the workspace as a whole.
const DOCUMENTS: [&str; 6] = [
    "README.md",
    "ARCHITECTURE.md",
    "CONTRIBUTING.md",
    "CHANGELOG.md",
    "LICENSE-MIT",
    "LICENSE-APACHE",
];

/// Fails with all problems at once.
pub(super) fn check(workspace: &Workspace) -> Result<()> {
    let mut problems = forbidden_dependencies(&workspace.packages);
    for package in &workspace.packages {
        problems.extend(crate_problems(package)?);
        if package.features.contains_key("gpu") && needs_wgpu(package)? {
            problems.push(format!(
                "{} needs wgpu without its feature gpu",
                package.name
            ));
        }
    }
    for document in DOCUMENTS.map(|name| root().join(name)) {
        if !document.exists() {
            problems.push(format!("{} is missing", document.display()));
        } else if document.extension().is_some() {
            problems.extend(dead_links(&document)?);
        }
    }
    if !problems.is_empty() {
        bail!("{}", problems.join("\n"));
    }
    Ok(())
}

/// Which of our own crates a crate may depend on, by any kind of dependency; `None` for a crate the rule does not know.
fn allowed(name: &str) -> Option<&'static [&'static str]> {
    const EVERYTHING: [&str; 6] = [
        "isophote-scene",
        "isophote-filters",
        "isophote-ldi",
        "isophote-ldm-ambient",
        "isophote-displacement-field",
        "isophote-instant-gi",
    ];
    match name {
        "isophote-scene" | "xtask" => Some(&[]),
        "isophote-filters" => Some(&EVERYTHING[..1]),
        "isophote" => Some(&EVERYTHING),
        _ if TECHNIQUES.contains(&name) => Some(&EVERYTHING[..2]),
        _ => None,
    }
}

/// The dependency rule. Direct dependencies are enough: all of our crates are members, so each is looked at.
fn forbidden_dependencies(packages: &[Package]) -> Vec<String> {
    let mut problems = Vec::new();
    for package in packages {
        let name = &package.name;
        let Some(allowed) = allowed(name) else {
            problems.push(format!(
                "{name} is new: say what it may depend on in {}",
                file!()
            ));
            continue;
        };
        for dependency in &package.dependencies {
            let dependency = &dependency.name;
            let is_ours = packages.iter().any(|other| other.name == *dependency);
            // A crate turns its own features on for its tests by depending on itself.
            if is_ours && dependency != name && !allowed.contains(&dependency.as_str()) {
                problems.push(format!("{name} must not depend on {dependency}"));
            }
        }
    }
    problems
}

/// Whether wgpu is among what a crate is built of with no features.
fn needs_wgpu(package: &Package) -> Result<bool> {
    let words = [
        "tree",
        "--no-default-features",
        "--edges",
        "normal,build",
        "--prefix",
        "none",
    ];
    let tree = output(cargo(words).args(["--package", &package.name]))?;
    Ok(tree.lines().any(|line| line.starts_with("wgpu ")))
}

/// What one crate lacks.
fn crate_problems(package: &Package) -> Result<Vec<String>> {
    let mut problems = Vec::new();
    let manifest = read(&package.manifest_path)?;
    if !manifest.contains("[lints]\nworkspace = true\n") {
        problems.push(format!(
            "{} does not take the workspace's lints",
            package.manifest_path.display()
        ));
    }
    let readme = package.folder().join("README.md");
    match fs::read_to_string(&readme) {
        Err(error) => problems.push(format!("{}: {error}", readme.display())),
        Ok(text) => {
            if first_paragraph(&text).split_whitespace().count() < 10 {
                problems.push(format!(
                    "{}: the first paragraph does not say what the crate is",
                    readme.display()
                ));
            }
            problems.extend(dead_links(&readme)?);
        }
    }
    if TECHNIQUES.contains(&package.name.as_str()) {
        problems.extend(technique_problems(package.folder())?);
    }
    Ok(problems)
}

/// The files that every technique has once it has any, so that who knows one knows all.
const ROOMS: [&str; 6] = [
    "src/params.rs",
    "src/error.rs",
    "src/cpu.rs",
    "tests/cpu.rs",
    "tests/reference.rs",
    "examples/minimal.rs",
];

/// What a technique names that it must not know, and which of its rooms are missing.
fn technique_problems(folder: &Path) -> Result<Vec<String>> {
    let mut problems = Vec::new();
    for file in files(&folder.join("src"), "rs")? {
        if file.file_name().is_some_and(|name| name == "tests.rs") {
            continue;
        }
        let text = read(&file)?;
        problems.extend(
            named_tracers(&text)
                .map(|(line, name)| format!("{}:{line} names {name}", file.display())),
        );
    }
    let shaders = folder.join("shaders");
    if shaders.is_dir() {
        for file in files(&shaders, "wesl")? {
            if read(&file)?.contains("scene::tracer::") {
                problems.push(format!("{} names a concrete tracer", file.display()));
            }
        }
        if !folder.join("tests/shaders.rs").exists() {
            problems.push(format!("{} has no tests/shaders.rs", folder.display()));
        }
    }
    if folder.join("src/cpu.rs").exists() {
        let missing = ROOMS.iter().filter(|room| !folder.join(room).exists());
        problems.extend(missing.map(|room| format!("{} has no {room}", folder.display())));
    }
    Ok(problems)
}

/// The first paragraph after the title.
fn first_paragraph(markdown: &str) -> &str {
    let mut paragraphs = markdown.split("\n\n").map(str::trim);
    paragraphs
        .find(|paragraph| !paragraph.is_empty() && !paragraph.starts_with('#'))
        .unwrap_or_default()
}

/// Lines, counted from 1, that name a concrete tracer outside comments and tests.
fn named_tracers(code: &str) -> impl Iterator<Item = (usize, &'static str)> {
    let mut after_test = false;
    // Modules of tests come last; of other items for tests, those of one line are passed over.
    let lines = code.lines().enumerate().map_while(move |(number, line)| {
        let is_test = std::mem::replace(&mut after_test, line.trim() == "#[cfg(test)]");
        match is_test {
            true if line.trim_end().ends_with('{') => None,
            true => Some((number, "")),
            false => Some((number, line)),
        }
    });
    lines
        .filter(|(_, line)| !line.trim_start().starts_with("//"))
        .flat_map(|(number, line)| {
            let names = CONCRETE_TRACERS.into_iter();
            names
                .filter(|name| line.contains(name))
                .map(move |name| (number + 1, name))
        })
}

/// Links of a Markdown file to files that are not there.
fn dead_links(file: &Path) -> Result<Vec<String>> {
    let folder = file.parent().unwrap_or(file);
    let text = read(file)?;
    let dead = relative_links(&text).filter(|link| !folder.join(link).exists());
    Ok(dead
        .map(|link| format!("{}: the link to {link} leads nowhere", file.display()))
        .collect())
}

/// Targets of the links and pictures outside code blocks that are paths, without their `#fragment`.
fn relative_links(markdown: &str) -> impl Iterator<Item = &str> {
    let prose = markdown.split("```").step_by(2);
    prose
        .flat_map(|text| text.split("](").skip(1))
        .filter_map(|rest| rest.split([')', '#']).next())
        .filter(|link| !link.is_empty() && !link.contains(':'))
}

/// Files with an extension, in a folder and those below it.
fn files(folder: &Path, wanted: &str) -> Result<Vec<std::path::PathBuf>> {
    let mut found = Vec::new();
    for entry in
        fs::read_dir(folder).with_context(|| format!("cannot list {}", folder.display()))?
    {
        let path = entry?.path();
        if path.is_dir() {
            found.extend(files(&path, wanted)?);
        } else if path
            .extension()
            .is_some_and(|extension| extension == wanted)
        {
            found.push(path);
        }
    }
    Ok(found)
}

fn read(file: &Path) -> Result<String> {
    fs::read_to_string(file).with_context(|| format!("cannot read {}", file.display()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::workspace::Dependency;

    fn package(name: &str, dependencies: &[&str]) -> Package {
        let dependency = |name: &&str| Dependency {
            name: (*name).to_owned(),
        };
        Package {
            name: name.to_owned(),
            manifest_path: "Cargo.toml".into(),
            dependencies: dependencies.iter().map(dependency).collect(),
            features: [].into(),
        }
    }

    #[test]
    fn techniques_depend_on_scene_and_filters_only() {
        let packages = [
            package("isophote-scene", &["glam", "isophote-scene"]),
            package("isophote-filters", &[]),
            package(
                "isophote-ldi",
                &["isophote-scene", "isophote-filters", "glam"],
            ),
            package("isophote-instant-gi", &["isophote-scene", "isophote-ldi"]),
            package("isophote", &["isophote-ldi", "isophote-instant-gi"]),
            package("isophote-new", &[]),
        ];
        let problems = forbidden_dependencies(&packages);
        assert_eq!(problems.len(), 2, "{problems:?}");
        assert_eq!(
            problems[0],
            "isophote-instant-gi must not depend on isophote-ldi"
        );
        assert!(problems[1].starts_with("isophote-new is new"));
    }

    #[test]
    fn concrete_tracers_are_found_in_code_alone() {
        let code = "/// See [`BvhTracer`].\nuse a::BvhTracer;\n#[cfg(test)]\nuse a::BruteForceTracer;\n\
                    fn f(_: BvhTracer) {}\n#[cfg(test)]\nmod tests {\n    use a::BvhTracer;\n}\n";
        let found: Vec<_> = named_tracers(code).collect();
        assert_eq!(found, [(2, "BvhTracer"), (5, "BvhTracer")]);
    }

    #[test]
    fn links_are_paths_outside_code() {
        let text = "[a](b.md#c) [d](https://e) [f](#g)\n```\nh[0](i)\n```\n![j](k/l.png)";
        assert_eq!(
            relative_links(text).collect::<Vec<_>>(),
            ["b.md", "k/l.png"]
        );
    }

    #[test]
    fn the_first_paragraph_comes_after_the_title() {
        assert_eq!(
            first_paragraph("# Title\n\nWhat it\nis.\n\nMore."),
            "What it\nis."
        );
        assert_eq!(first_paragraph("# Title\n"), "");
    }
}
