//! `--tracer field` and `--technique field`: pictures, files, and what is refused.

use std::path::Path;

use assert_cmd::Command;

fn isophote(arguments: &[&str]) -> Command {
    let mut command = Command::cargo_bin("isophote").expect("the program");
    command.args(arguments);
    command
}

fn render(output: &Path, more: &[&str]) -> Command {
    let mut command = isophote(&[
        "render",
        "builtin:corner",
        "--device=cpu",
        "--size=32x24",
        "--spp=8",
        "--tracer=field",
        "--field-rings=8",
        "--quantity=ao",
        "--quiet",
        "-o",
    ]);
    command.arg(output).args(more);
    command
}

#[test]
fn fields_are_saved_and_loaded() {
    let folder = tempfile::tempdir().expect("a folder");
    let at = |name: &str| folder.path().join(name);
    let fields = at("fields");
    let flag = |name: &str| format!("{name}={}", fields.display());
    render(&at("a.exr"), &[&flag("--field-save")])
        .assert()
        .success();
    isophote(&[
        "render",
        "builtin:corner",
        "--device=cpu",
        "--size=32x24",
        "--spp=8",
    ])
    .args([
        // Another name for the same.
        "--technique=field",
        "--quantity=ao",
        "--quiet",
        &flag("--field-load"),
        "-o",
    ])
    .arg(at("b.exr"))
    .assert()
    .success();
    let compared = isophote(&["compare", "--json"])
        .arg(at("a.exr"))
        .arg(at("b.exr"))
        .output();
    let report = String::from_utf8(compared.expect("a report").stdout).expect("text");
    let report: serde_json::Value = serde_json::from_str(&report).expect("JSON");
    assert_eq!(report["rel_rmse"].as_f64(), Some(0.0), "{report}");
}

#[test]
fn what_needs_surfaces_is_refused() {
    let folder = tempfile::tempdir().expect("a folder");
    let refused = render(&folder.path().join("a.exr"), &["--quantity=indirect"]).output();
    let error = String::from_utf8(refused.expect("an answer").stderr).expect("text");
    assert!(
        error.contains("Surface") && error.contains("Distance"),
        "{error}"
    );
    let refused = isophote(&[
        "render",
        "builtin:corner",
        "--technique=field",
        "--quantity=ao",
        "--tracer=bvh",
        "-o",
        "a.exr",
    ]);
    let error = String::from_utf8({ refused }.output().expect("an answer").stderr).expect("text");
    assert!(error.contains("leave out --tracer"), "{error}");
    let idle = isophote(&["render", "builtin:corner", "--field-rings=3", "-o", "a.exr"]).output();
    let error = String::from_utf8(idle.expect("an answer").stderr).expect("text");
    assert!(error.contains("it is for the tracer field"), "{error}");
}
