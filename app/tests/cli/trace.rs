//! Rays from files.

use std::fs;

use crate::Place;

#[test]
fn tracers_agree_on_rays_from_files() {
    let place = Place::new();
    for kind in ["diffuse", "coherent", "shadow"] {
        let rays = format!("{kind}.npy");
        place.ok(&[
            "trace",
            "builtin:cornell",
            "--make",
            kind,
            "--count=2000",
            "-q",
            "-o",
            &rays,
        ]);
        let mut found = Vec::new();
        for (tracer, levels, mode) in [
            ("bvh", "auto", "closest"),
            ("brute-force", "auto", "closest"),
            ("bvh", "two", "closest"),
            ("bvh", "auto", "any"),
            ("bvh", "two", "any"),
        ] {
            let report = place.json(&[
                "trace",
                "builtin:cornell",
                "--rays",
                &rays,
                "--tracer",
                tracer,
                "--bvh-levels",
                levels,
                "--mode",
                mode,
                "--repeat=2",
                "--threads=1",
                "--json",
                "-o",
                "hits.npy",
            ]);
            assert_eq!(report["rays"], 2000);
            assert_eq!(report["mode"], mode);
            for number in ["rays_per_second", "build_seconds", "bytes", "trace_seconds"] {
                assert!(report[number].as_f64().unwrap() > 0.0, "{number}");
            }
            let hits = fs::read(place.path("hits.npy")).unwrap();
            found.push((report["hits"].as_u64().unwrap(), hits));
        }
        assert_eq!(found[0], found[1], "{kind}");
        assert_eq!(found[0], found[2], "{kind}");
        assert_eq!([found[3].0, found[4].0], [found[0].0; 2], "{kind}");
        assert!(found[0].0 > 0, "{kind}");
    }
}

#[test]
fn odd_rays_miss_and_odd_files_are_refused() {
    let place = Place::new();
    let header = |shape: &str| {
        let text = format!("{{'descr': '<f4', 'fortran_order': False, 'shape': {shape}, }}\n");
        let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
        bytes.extend((text.len() as u16).to_le_bytes());
        bytes.extend(text.into_bytes());
        bytes
    };
    let rays = [
        [0.278, 0.273, -0.8, 0.0, 0.0, 0.0, 1.0, f32::INFINITY],
        [f32::NAN, 0.273, -0.8, 0.0, 0.0, 0.0, 1.0, 9.0],
        [0.278, 0.273, -0.8, 0.0, 0.0, 0.0, 0.0, 9.0],
        [0.278, 0.273, -0.8, 0.0, 0.0, f32::INFINITY, 1.0, 9.0],
        [0.278, 0.273, -0.8, 0.0, 0.0, 0.0, 2.0, f32::NAN],
        [0.278, 0.273, -0.8, 0.0, 0.0, 0.0, 2.0, 9.0],
    ];
    let data: Vec<u8> = rays
        .iter()
        .flatten()
        .flat_map(|x: &f32| x.to_le_bytes())
        .collect();
    place.put("rays.npy", [header("(6, 8)"), data.clone()].concat());
    place.put("none.npy", header("(0, 8)"));
    place.put("cut.npy", [header("(7, 8)"), data.clone()].concat());
    place.put("shape.npy", [header("(48,)"), data].concat());
    place.put("empty.npy", "").put("text.npy", "rays");
    let trace = |rays| ["trace", "builtin:cornell", "--rays", rays, "-o", "hits.npy"];
    let said = place.ok(&trace("rays.npy"));
    assert!(
        said.contains("1 rays") && said.contains("unit length"),
        "{said}"
    );
    let bytes = fs::read(place.path("hits.npy")).unwrap();
    let data = bytes.len() - 6 * 20;
    let value = |i: usize| f32::from_le_bytes(bytes[data + 4 * i..][..4].try_into().unwrap());
    assert!(value(0).is_finite() && (value(25) - 0.5 * value(0)).abs() < 1e-6);
    for ray in 1..5 {
        let row: Vec<f32> = (0..5).map(|column| value(5 * ray + column)).collect();
        assert_eq!(row, [f32::INFINITY, 0.0, 0.0, -1.0, -1.0], "{ray}");
    }
    place.ok(&trace("none.npy"));
    let refuse = |rays, expected| {
        place.refused(
            &["trace", "builtin:cornell", "--rays", rays, "-o", "out.npy"],
            expected,
        );
    };
    refuse("no.npy", "no.npy");
    refuse("cut.npy", "cut");
    refuse("shape.npy", "(N, 8)");
    refuse("empty.npy", "empty");
    refuse("text.npy", "npy");
    place.refused(&["trace", "builtin:cornell", "-o", "out.npy"], "--rays");
    place.refused(
        &["trace", "builtin:cornell", "--make=odd", "-o", "out.npy"],
        "diffuse",
    );
    place.refused(
        &[
            "trace",
            "builtin:cornell",
            "--make=diffuse",
            "--count=0",
            "-o",
            "out.npy",
        ],
        "--count",
    );
}
