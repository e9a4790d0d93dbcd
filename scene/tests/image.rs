//! Image files: what is written is read again, and what is wrong is refused.

#![cfg(feature = "exr")]

use std::path::{Path, PathBuf};

use glam::Vec3;
use isophote_scene::{Error, Image};

fn sample_image() -> Image {
    let mut image = Image::new(5, 3);
    let values: Vec<Vec3> = (0..15)
        .map(|i| Vec3::new(i as f32, -0.25 * i as f32, 1e-30 * i as f32))
        .collect();
    image.push_layer("", "RGB", &values);
    image.push_layer("normal", "XYZ", &values);
    let mut depth = vec![f32::INFINITY; 15];
    depth[3] = f32::NAN;
    depth[4] = 1.5;
    image.push("depth.Z", depth);
    image.attributes.insert("seed".into(), "7".into());
    image
        .attributes
        .insert("scene".into(), "Šibenik 教堂.glb".into());
    image
}

fn shared(path: &str) -> Option<PathBuf> {
    let path = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../../shared")).join(path);
    if path.exists() {
        return Some(path);
    }
    eprintln!("skipped: {} is absent", path.display());
    None
}

#[test]
fn exr_keeps_every_bit_and_every_attribute() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.exr");
    let image = sample_image();
    image.save(&path).unwrap();
    let read = Image::load(&path).unwrap();
    assert_eq!((read.width, read.height), (5, 3));
    assert_eq!(read.attributes, image.attributes);
    assert_eq!(read.channels.len(), image.channels.len());
    for channel in &image.channels {
        let bits = |samples: &[f32]| samples.iter().map(|x| x.to_bits()).collect::<Vec<_>>();
        let found = read.channel(&channel.name).expect(&channel.name);
        assert_eq!(bits(found), bits(&channel.samples), "{}", channel.name);
    }
}

#[test]
fn exr_files_repeat_byte_for_byte() {
    let folder = tempfile::tempdir().unwrap();
    let paths = ["a.exr", "b.exr"].map(|name| folder.path().join(name));
    let mut image = Image::new(640, 480);
    let noise = (0..640 * 480_u32).map(|i| (i.wrapping_mul(2_654_435_761) >> 8) as f32);
    image.push("Y", noise.collect());
    for i in 0..20 {
        image
            .attributes
            .insert(format!("attribute {i}"), "x".repeat(i));
    }
    for path in &paths {
        image.save(path).unwrap();
    }
    let [a, b] = paths.map(|path| std::fs::read(path).unwrap());
    assert!(a == b);
}

#[test]
fn exr_of_other_programs_is_read_whatever_its_kind() {
    use exr::prelude::{
        AnyChannel, AnyChannels, Blocks, Compression, Encoding, FlatSamples, Layer,
        LayerAttributes, LineOrder, Vec2, WritableImage, f16,
    };
    let folder = tempfile::tempdir().unwrap();
    let values: Vec<f32> = (0..40 * 30).map(|i| 0.25 * (i % 97) as f32).collect();
    let mut encodings = Vec::new();
    for compression in [
        Compression::Uncompressed,
        Compression::RLE,
        Compression::ZIP1,
        Compression::PIZ,
    ] {
        encodings.push((compression, Blocks::ScanLines, LineOrder::Decreasing));
        encodings.push((
            compression,
            Blocks::Tiles(Vec2(16, 16)),
            LineOrder::Unspecified,
        ));
    }
    for (number, (compression, blocks, line_order)) in encodings.into_iter().enumerate() {
        let encoding = Encoding {
            compression,
            blocks,
            line_order,
        };
        let half = values.iter().map(|&value| f16::from_f32(value)).collect();
        let whole = values.iter().map(|&value| value as u32).collect();
        let channels = [
            AnyChannel::new("B", FlatSamples::U32(whole)),
            AnyChannel::new("G", FlatSamples::F16(half)),
            AnyChannel::new("R", FlatSamples::F32(values.clone())),
        ];
        let channels = AnyChannels::sort(channels.into_iter().collect());
        let layer = Layer::new((40, 30), LayerAttributes::named("main"), encoding, channels);
        let path = folder.path().join(format!("{number}.exr"));
        let file = exr::prelude::Image::from_layer(layer);
        file.write().to_file(&path).unwrap();
        let image = Image::load(&path).unwrap();
        assert_eq!((image.width, image.height), (40, 30));
        for (pixel, &value) in image.rgb("").unwrap().iter().zip(&values) {
            assert_eq!(
                *pixel,
                Vec3::new(value, value, value.floor()),
                "{encoding:?}"
            );
        }
    }
}

#[test]
fn png_is_srgb_and_names_its_exposure() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.png");
    let mut image = Image::new(4, 1);
    let values = [
        Vec3::splat(0.25),
        Vec3::new(0.0, 0.5, 9.0),
        Vec3::splat(f32::NAN),
        Vec3::new(-1.0, f32::INFINITY, 0.1),
    ];
    image.push_layer("", "RGB", &values);
    image.attributes.insert("camera".into(), "日本".into());
    image.attributes.insert("exposure".into(), "7".into());
    image.save_png(&path, 1.0).unwrap();
    let decoder = png::Decoder::new(std::io::BufReader::new(std::fs::File::open(&path).unwrap()));
    let mut reader = decoder.read_info().unwrap();
    let mut bytes = vec![0; reader.output_buffer_size().unwrap()];
    reader.next_frame(&mut bytes).unwrap();
    // 0.5 is 188 in sRGB and 0.2 is 124 (IEC 61966-2-1).
    assert_eq!(bytes, [188, 188, 188, 0, 255, 255, 0, 0, 0, 0, 255, 124]);
    let info = reader.info();
    assert_eq!(info.uncompressed_latin1_text.len(), 1);
    let exposure = &info.uncompressed_latin1_text[0];
    assert_eq!(exposure.keyword, "exposure");
    assert!(exposure.text.starts_with("1 stops"), "{}", exposure.text);
    assert_eq!(info.utf8_text[0].get_text().unwrap(), "日本");
    let read = Image::load(&path).unwrap().rgb("").unwrap();
    assert!((read[0] - Vec3::splat(0.5)).abs().max_element() < 3e-3);
}

#[test]
fn png_without_a_picture_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.png");
    let mut image = Image::new(1, 1);
    image.push("depth.Z", vec![1.0]);
    assert!(matches!(image.save(&path), Err(Error::Parameter { .. })));
    assert!(!path.exists());
}

#[test]
fn unknown_suffixes_name_the_known_ones() {
    for error in [
        Image::load("a.xyz").unwrap_err(),
        sample_image().save("a.jpg").unwrap_err(),
        sample_image().save("a").unwrap_err(),
    ] {
        assert!(matches!(error, Error::UnknownFormat { .. }));
        assert!(error.to_string().contains(".exr"), "{error}");
    }
}

#[test]
fn cut_files_are_errors_at_every_length() {
    let folder = tempfile::tempdir().unwrap();
    for name in ["a.exr", "a.png"] {
        let whole = folder.path().join(name);
        sample_image().save(&whole).unwrap();
        let bytes = std::fs::read(&whole).unwrap();
        let cut = folder.path().join(format!("cut-{name}"));
        // The last twelve bytes of a PNG only say that it ends.
        for length in 0..bytes.len() - 12 {
            std::fs::write(&cut, &bytes[..length]).unwrap();
            let error = Image::load(&cut).expect_err(&format!("{name} of {length} bytes"));
            assert!(matches!(error, Error::Malformed { .. }), "{error}");
        }
    }
}

#[test]
fn broken_bytes_never_panic() {
    let folder = tempfile::tempdir().unwrap();
    for name in ["a.exr", "a.png"] {
        let whole = folder.path().join(name);
        sample_image().save(&whole).unwrap();
        let bytes = std::fs::read(&whole).unwrap();
        let broken = folder.path().join(format!("broken-{name}"));
        let mut random = 1_u64;
        for _ in 0..400 {
            let mut bytes = bytes.clone();
            for _ in 0..4 {
                random = random
                    .wrapping_mul(6_364_136_223_846_793_005)
                    .wrapping_add(1);
                let at = (random >> 33) as usize % bytes.len();
                bytes[at] = (random >> 24) as u8;
            }
            std::fs::write(&broken, &bytes).unwrap();
            // Either answer is right: some bytes are only pixels.
            let _ = Image::load(&broken);
        }
    }
}

#[test]
fn a_lying_header_allocates_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.exr");
    let mut image = Image::new(16, 16);
    image.push("Y", vec![0.0; 256]);
    image.save(&path).unwrap();
    let mut bytes = std::fs::read(&path).unwrap();
    // dataWindow: name, 0, "box2i", 0, size 16, then x_min, y_min, x_max, y_max.
    for window in [&b"dataWindow\0box2i\0"[..], b"displayWindow\0box2i\0"] {
        let at = bytes.windows(window.len()).position(|part| part == window);
        let at = at.unwrap() + window.len() + 4 + 8;
        bytes[at..at + 4].copy_from_slice(&16_383_i32.to_le_bytes());
        bytes[at + 4..at + 8].copy_from_slice(&16_383_i32.to_le_bytes());
    }
    std::fs::write(&path, &bytes).unwrap();
    let error = Image::load(&path).unwrap_err().to_string();
    assert!(error.contains("cannot hold"), "{error}");
}

#[test]
fn references_of_another_renderer_are_read() {
    let Some(path) = shared("references/cornell_original.direct.exr") else {
        return;
    };
    let image = Image::load(path).unwrap();
    assert_eq!((image.width, image.height), (320, 240));
    let pixels = image.rgb("").expect("R, G, B");
    assert!(
        pixels
            .iter()
            .all(|pixel| pixel.is_finite() && pixel.min_element() >= 0.0)
    );
    assert!(pixels.iter().any(|pixel| pixel.max_element() > 0.1));
}
