//! Shaders that change while the program runs. Alone in its process, as all linkers hear of it.
#![cfg(feature = "gpu")]

use std::collections::BTreeMap;

use isophote_scene::{
    Error,
    gpu::{Linker, replace_modules},
};

const FILE: &str = "scene/shaders/shadow/raster.wesl";

#[test]
fn texts_stand_in_for_modules_and_are_put_back() {
    let embedded = include_str!("../shaders/shadow/raster.wesl");
    let link = || Linker::default().link("scene::shadow::raster");
    let with = |more: &str| {
        let text = format!("{embedded}\n{more}\n");
        replace_modules(BTreeMap::from([(FILE.to_owned(), text)]))
    };
    // Linked modules follow each other in any order.
    let lines = || {
        let linked = link().unwrap();
        let mut lines: Vec<String> = linked.wgsl().lines().map(str::to_owned).collect();
        lines.sort_unstable();
        lines
    };
    let before = lines();

    assert!(with("@fragment\nfn one_more() { discard; }").is_empty());
    assert!(link().unwrap().wgsl().contains("one_more"));

    let good = with("@fragment\nfn one_more() { let wrong: u32 = 1.5f; }");
    match link() {
        Err(Error::Shader { file, line, .. }) => {
            let last = embedded.lines().count() as u32 + 3;
            assert_eq!((file.as_str(), line), (FILE, last));
        }
        other => panic!("{other:?}"),
    }
    replace_modules(good);
    assert!(link().unwrap().wgsl().contains("one_more"));
    replace_modules(BTreeMap::new());
    assert_eq!(lines(), before);
}
