//! The same bits whoever computes them: threads, shards, all in one.

use crate::{Place, files::plate_over_floor};

const TEXELS: &str = "a.glb --to texels --size 160 --samples 4";

fn bytes(place: &Place, name: &str) -> Vec<u8> {
    std::fs::read(place.path(name)).unwrap()
}

#[test]
fn shards_and_threads_make_the_same_bits() {
    let place = Place::with("a.glb", plate_over_floor().glb());
    for (name, bake) in [
        ("ao", "--seed 3"),
        ("ldm", "--technique ldm --ldm-maps 16"),
        ("light", "--quantity irradiance --environment 1,2,3"),
        (
            "igi",
            "--technique igi --quantity irradiance.indirect --environment 1,2,3 --igi-paths 16 --igi-compensation 2",
        ),
    ] {
        let bake = match name {
            "ldm" | "igi" => TEXELS.replace(" --samples 4", "") + " " + bake,
            _ => format!("{TEXELS} {bake}"),
        };
        place.ok(&format!("{bake} --threads 1 -o one.glb"));
        place.ok(&format!("{bake} --threads 3 -o three.glb"));
        assert!(
            bytes(&place, "one.glb") == bytes(&place, "three.glb"),
            "{name}"
        );
        for number in 1..=3 {
            place.ok(&format!("{bake} --shard {number}/3 -o {number}.part"));
        }
        // In any order, and without saying the settings again.
        place.ok("a.glb -o merged.glb --merge 2.part 3.part 1.part");
        assert!(
            bytes(&place, "one.glb") == bytes(&place, "merged.glb"),
            "{name}"
        );
    }
}

#[test]
fn parts_that_do_not_belong_together_are_refused() {
    let place = Place::with("a.glb", plate_over_floor().glb());
    for number in 1..=2 {
        place.ok(&format!("{TEXELS} --shard {number}/2 -o {number}.part"));
    }
    place.ok(&format!("{TEXELS} --shard 2/2 --seed 1 -o seed.part"));
    place.ok(&format!("{TEXELS} --shard 1/3 -o third.part"));
    let mut damaged = bytes(&place, "2.part");
    let middle = damaged.len() / 2;
    damaged[middle] ^= 1;
    std::fs::write(place.path("damaged.part"), &damaged).unwrap();
    std::fs::write(place.path("cut.part"), &damaged[..middle]).unwrap();
    let mut other = plate_over_floor();
    other.json["nodes"][1]["translation"] = serde_json::json!([0.0, 2.0, 0.0]);
    std::fs::write(place.path("other.glb"), other.glb()).unwrap();
    for (arguments, part) in [
        ("a.glb -o b.glb --merge 1.part", "these are missing: 2"),
        ("a.glb -o b.glb --merge 1.part 1.part", "both part 1 of 2"),
        ("a.glb -o b.glb --merge 1.part third.part", "one of"),
        ("a.glb -o b.glb --merge 1.part seed.part", "--seed 1, not 0"),
        (
            "a.glb --seed 5 -o b.glb --merge 1.part 2.part",
            "--seed 0, not 5",
        ),
        ("a.glb -o b.glb --merge 1.part damaged.part", "checksum"),
        ("a.glb -o b.glb --merge 1.part cut.part", "cut off"),
        ("a.glb -o b.glb --merge 1.part a.glb", "no file of"),
        ("a.glb -o b.glb --merge a.glb", "no file of"),
        ("a.glb -o b.glb --merge 1.part none.part", "none.part"),
        ("other.glb -o b.glb --merge 1.part 2.part", "another scene"),
    ] {
        let said = place.refused(arguments);
        assert!(said.contains(part), "{arguments}: {said}");
    }
    assert!(!place.path("b.glb").exists());
}
