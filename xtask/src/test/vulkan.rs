//! A Vulkan driver for the GPU tests: any machine can have Mesa's llvmpipe, which needs no GPU.
//!
//! Without a driver the GPU tests say that they are skipped, unless the environment variable `ISOPHOTE_REQUIRE_GPU` is
//! 1, as CI sets it. Ray query needs Mesa 25 or newer; Debian 12 has that in its backports.

use std::{fs, path::Path, process::Command};

use anyhow::Result;

use super::tools::may_use_apt;
use crate::workspace::run;

/// Where drivers say that they are there.
const MANIFESTS: [&str; 2] = ["/usr/share/vulkan/icd.d", "/etc/vulkan/icd.d"];
const PACKAGES: [&str; 2] = ["mesa-vulkan-drivers", "libvulkan1"];
const BACKPORTS: &str = "bookworm-backports";
/// The first whose llvmpipe is known to answer ray queries rightly.
const MESA: u32 = 25;

/// Sees to a driver, or says what is missing. Only Linux is looked after: others have drivers of their own.
pub(super) fn provide(install: bool) -> Result<()> {
    if !cfg!(target_os = "linux") {
        return Ok(());
    }
    let Some(problem) = problem() else {
        return Ok(());
    };
    eprintln!("{problem}");
    if !install || !may_use_apt() {
        eprintln!(
            "GPU tests will be skipped. To run them: sudo apt-get install {}, on Debian 12 from {BACKPORTS}",
            PACKAGES.join(" ")
        );
        return Ok(());
    }
    eprintln!("installing {} with apt-get", PACKAGES.join(", "));
    let from_backports = codename() == Some("bookworm".into());
    if from_backports {
        add_backports()?;
    }
    run(Command::new("apt-get").args(["update", "--quiet"]))?;
    let mut install = Command::new("apt-get");
    install.args(["install", "--yes", "--quiet"]);
    if from_backports {
        install.args(["--target-release", BACKPORTS]);
    }
    run(install
        .args(PACKAGES)
        .env("DEBIAN_FRONTEND", "noninteractive"))
}

/// What is wrong with the drivers that are there.
fn problem() -> Option<String> {
    let has_manifest =
        |folder: &str| fs::read_dir(folder).is_ok_and(|mut files| files.next().is_some());
    if !MANIFESTS.into_iter().any(has_manifest) {
        return Some("missing: a Vulkan driver, for the GPU tests".into());
    }
    let mesa = mesa_version()?;
    (mesa < MESA).then(|| {
        format!(
            "Mesa {mesa} is too old: ray query needs Mesa {MESA} or newer on machines without a GPU"
        )
    })
}

/// The major version of Mesa's Vulkan drivers, where Debian's package manager knows it.
fn mesa_version() -> Option<u32> {
    let query = ["--show", "--showformat=${Version}", PACKAGES[0]];
    let output = Command::new("dpkg-query").args(query).output().ok()?;
    major(&String::from_utf8_lossy(&output.stdout))
}

fn major(version: &str) -> Option<u32> {
    version.split('.').next()?.parse().ok()
}

fn codename() -> Option<String> {
    let release = fs::read_to_string("/etc/os-release").ok()?;
    let name = release
        .lines()
        .find_map(|line| line.strip_prefix("VERSION_CODENAME="))?;
    Some(name.trim_matches('"').to_owned())
}

/// Makes Debian's backports known to apt, from the place that the other packages come from.
fn add_backports() -> Result<()> {
    let file = Path::new("/etc/apt/sources.list.d/bookworm-backports.sources");
    if file.exists() {
        return Ok(());
    }
    let sources = fs::read_to_string("/etc/apt/sources.list.d/debian.sources").unwrap_or_default();
    let source = backports_source(&sources);
    eprintln!("writing {}", file.display());
    Ok(fs::write(file, source)?)
}

/// A source of backports like the first in a file of sources.
fn backports_source(sources: &str) -> String {
    let field = |name: &str, otherwise: &str| {
        let found = sources.lines().find_map(|line| line.strip_prefix(name));
        found.map_or_else(|| otherwise.to_owned(), |value| value.trim().to_owned())
    };
    format!(
        "Types: deb\nURIs: {}\nSuites: {BACKPORTS}\nComponents: main\nSigned-By: {}\n",
        field("URIs:", "http://deb.debian.org/debian"),
        field(
            "Signed-By:",
            "/usr/share/keyrings/debian-archive-keyring.gpg"
        ),
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn versions_are_read() {
        assert_eq!(major("25.0.7-2~bpo12+1"), Some(25));
        assert_eq!(major("22.3.6-1+deb12u1"), Some(22));
        assert_eq!(major(""), None);
    }

    #[test]
    fn backports_come_from_where_the_rest_does() {
        let sources = "Types: deb\n# URIs: no\nURIs: http://mirror/debian\nSuites: bookworm\nSigned-By: /key.gpg\n\n\
                       Types: deb\nURIs: http://mirror/security\n";
        let source = backports_source(sources);
        assert!(source.contains("URIs: http://mirror/debian\nSuites: bookworm-backports\n"));
        assert!(source.ends_with("Signed-By: /key.gpg\n"));
    }
}
