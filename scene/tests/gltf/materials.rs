//! Materials, textures and images.

use glam::{Vec2, Vec3, Vec4};
use isophote_scene::{Alpha, ColorSpace, Filter, Wrap};
use serde_json::json;

use crate::{
    loaded,
    support::{gltf::Gltf, png, seeds},
};

#[test]
fn materials_with_all_their_extensions() {
    let scene = loaded(&seeds::scene().glb());
    let [all, unlit] = &scene.materials[..] else {
        panic!("{:?}", scene.materials);
    };
    assert_eq!(all.name, "all");
    assert_eq!(all.base_color, Vec4::new(0.5, 0.6, 0.7, 1.0));
    assert_eq!((all.metallic, all.roughness), (0.5, 0.25));
    assert_eq!(all.emissive, Vec3::new(4.0, 2.0, 0.0));
    assert_eq!(all.alpha, Alpha::Mask { cutoff: 0.25 });
    assert_eq!((all.transmission, all.ior), (0.5, 1.33));
    assert!(!all.unlit && unlit.unlit && unlit.alpha == Alpha::Opaque);
    assert_eq!(all.emissive_texture, None, "its image is missing");
    // v points down, so a counter-clockwise turn takes +u towards −v.
    let texture = all.base_color_texture.unwrap();
    assert_eq!(texture.uv_set, 1);
    let found = texture.transform.transform_point2(Vec2::X);
    let expected = Vec2::new(0.1 + 2.0 * 0.5_f32.cos(), 0.2 - 2.0 * 0.5_f32.sin());
    assert!((found - expected).length() < 1e-6, "{found}");
    for part in [
        "normal maps",
        "occlusion maps",
        "missing.png",
        "BLEND",
        "X_unknown",
        "skins",
        "morph",
    ] {
        let warnings = &scene.report.warnings;
        assert_eq!(
            warnings.iter().filter(|line| line.contains(part)).count(),
            1,
            "{part} {warnings:?}"
        );
    }
}

#[test]
fn textures_know_their_color_space_wrap_and_filter() {
    let scene = loaded(&seeds::scene().glb());
    let material = &scene.materials[0];
    let texture = |reference: Option<isophote_scene::TextureRef>| {
        scene.textures[reference.unwrap().texture as usize].clone()
    };
    let color = texture(material.base_color_texture);
    assert_eq!(color.color_space, ColorSpace::Srgb);
    assert_eq!(color.size(), [2, 2]);
    assert_eq!(color.wrap, [Wrap::Clamp, Wrap::Mirror]);
    assert_eq!(color.filter, Filter::Nearest);
    assert_eq!(color.level(0).2[3], [255, 255, 255, 0]);
    let roughness = texture(material.metallic_roughness_texture);
    assert_eq!(roughness.color_space, ColorSpace::Linear);
    assert_eq!(
        material.metallic_roughness_texture,
        material
            .transmission_texture
            .map(|t| { isophote_scene::TextureRef { uv_set: 1, ..t } })
    );
    assert_eq!(scene.textures.len(), 2, "one image in two colour spaces");
}

#[test]
fn images_of_every_kind() {
    use image::{DynamicImage, ImageFormat};
    let rgb = DynamicImage::ImageRgba8(image::load_from_memory(&png()).unwrap().to_rgba8());
    let images = [
        (rgb.clone(), ImageFormat::WebP),
        (rgb.clone(), ImageFormat::Bmp),
        (rgb.clone(), ImageFormat::Tga),
        (rgb.clone(), ImageFormat::Gif),
        (DynamicImage::ImageRgba16(rgb.to_rgba16()), ImageFormat::Png),
        (DynamicImage::ImageLuma16(rgb.to_luma16()), ImageFormat::Png),
        (
            DynamicImage::ImageLumaA8(rgb.to_luma_alpha8()),
            ImageFormat::Png,
        ),
        (DynamicImage::ImageRgb8(rgb.to_rgb8()), ImageFormat::Jpeg),
    ];
    for (image, format) in images {
        let mut bytes = std::io::Cursor::new(Vec::new());
        image.write_to(&mut bytes, format).unwrap();
        let mut gltf = Gltf::new();
        gltf.add("images", json!({ "uri": "texture.tga" }));
        gltf.add("textures", json!({ "source": 0 }));
        gltf.add(
            "materials",
            json!({ "pbrMetallicRoughness": { "baseColorTexture": { "index": 0 } } }),
        );
        let shown = gltf.square();
        let mesh = gltf.json["nodes"][shown]["mesh"].as_u64().unwrap() as usize;
        gltf.json["meshes"][mesh]["primitives"][0]["material"] = json!(0);
        let scene = loaded(&gltf.glb().and("texture.tga", bytes.into_inner()));
        assert_eq!(scene.report.warnings, [""; 0], "{format:?}");
        assert_eq!(scene.textures[0].size(), [2, 2]);
        let [grey, ..] = image.to_rgba8().into_raw()[..] else {
            panic!("no pixels");
        };
        let found = scene.textures[0].level(0).2[0][0];
        assert!(
            found.abs_diff(grey) <= 1 || format == ImageFormat::Jpeg,
            "{format:?} {found} {grey}"
        );
    }
}
