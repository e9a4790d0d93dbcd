//! Parsers of the command line's values: what is out of range is refused with the range.

use glam::{Affine3A, Quat, Vec3};
use isophote_scene::Aabb;

/// A number that is neither NaN nor infinite.
pub(crate) fn finite(text: &str) -> Result<f32, String> {
    number(text, "a finite number", f32::is_finite)
}

/// A finite number of at least 0.
pub(crate) fn not_negative(text: &str) -> Result<f32, String> {
    number(text, "a finite number of at least 0", |value| {
        value.is_finite() && value >= 0.0
    })
}

/// A distance: above 0, perhaps infinite (`inf`).
pub(crate) fn distance(text: &str) -> Result<f32, String> {
    number(text, "a distance above 0 in metres, or inf", |value| {
        value > 0.0
    })
}

fn number(text: &str, expected: &str, valid: impl Fn(f32) -> bool) -> Result<f32, String> {
    text.trim()
        .parse()
        .ok()
        .filter(|&value| valid(value))
        .ok_or_else(|| format!("expected {expected}"))
}

/// As many finite numbers as `count` allows, divided by commas.
fn numbers(text: &str, count: std::ops::RangeInclusive<usize>) -> Option<Vec<f32>> {
    let values: Option<Vec<f32>> = text.split(',').map(|part| finite(part).ok()).collect();
    values.filter(|values| count.contains(&values.len()))
}

/// `WIDTHxHEIGHT` in pixels.
pub(crate) fn size(text: &str) -> Result<[u32; 2], String> {
    let most = isophote_scene::Image::MAX_SIDE;
    text.split_once(['x', '×'])
        .and_then(|(width, height)| Some([width.trim().parse().ok()?, height.trim().parse().ok()?]))
        .filter(|size: &[u32; 2]| size.iter().all(|side| (1..=most).contains(side)))
        .ok_or_else(|| {
            format!("expected WIDTHxHEIGHT with 1 to {most} pixels each, such as 640x480")
        })
}

/// A number of threads.
pub(crate) fn threads(text: &str) -> Result<usize, String> {
    text.parse()
        .ok()
        .filter(|count| (1..=1024).contains(count))
        .ok_or_else(|| "expected a number from 1 to 1024".into())
}

/// `NAME=metallic,roughness`.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct MaterialOverride {
    /// The material's name in the file.
    pub(crate) name: String,
    /// 0..=1.
    pub(crate) metallic: f32,
    /// 0..=1.
    pub(crate) roughness: f32,
}

/// Parses a [`MaterialOverride`].
pub(crate) fn material(text: &str) -> Result<MaterialOverride, String> {
    text.rsplit_once('=')
        .and_then(|(name, values)| Some((name, numbers(values, 2..=2)?)))
        .filter(|(_, values)| values.iter().all(|value| (0.0..=1.0).contains(value)))
        .map(|(name, values)| MaterialOverride {
            name: name.into(),
            metallic: values[0],
            roughness: values[1],
        })
        .ok_or_else(|| {
            "expected NAME=METALLIC,ROUGHNESS, both within 0..1, such as Gold=1,0.2".into()
        })
}

/// Where the light from outside comes from.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum EnvironmentChoice {
    /// The same radiance from everywhere.
    Constant(Vec3),
    /// A panorama file.
    File(std::path::PathBuf),
}

/// `r,g,b`, or a file.
pub(crate) fn environment(text: &str) -> Result<EnvironmentChoice, String> {
    match numbers(text, 3..=3) {
        Some(rgb) if rgb.iter().all(|&value| value >= 0.0) => Ok(EnvironmentChoice::Constant(
            Vec3::new(rgb[0], rgb[1], rgb[2]),
        )),
        Some(_) => Err("a radiance cannot be negative".into()),
        None if text.is_empty() => Err("expected R,G,B or a .exr or .hdr file".into()),
        None => Ok(EnvironmentChoice::File(text.into())),
    }
}

/// `FILE@x,y,z[,scale[,yaw]][:moving]`.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Addition {
    /// A scene file or `builtin:NAME`.
    pub(crate) scene: String,
    /// Where it goes.
    pub(crate) transform: Affine3A,
    /// Whether precomputed structures must leave it out.
    pub(crate) moving: bool,
}

/// Parses an [`Addition`].
pub(crate) fn addition(text: &str) -> Result<Addition, String> {
    let expected =
        "expected FILE@X,Y,Z[,SCALE[,YAW]][:moving] in metres and degrees, such as bunny.glb@0,1,0";
    let (rest, moving) = match text.strip_suffix(":moving") {
        Some(rest) => (rest, true),
        None => (text, false),
    };
    let (scene, place) = rest.rsplit_once('@').ok_or(expected)?;
    let values = numbers(place, 3..=5).ok_or(expected)?;
    let scale = values.get(3).copied().unwrap_or(1.0);
    if scale <= 0.0 || scene.is_empty() {
        return Err(expected.into());
    }
    let yaw = values.get(4).copied().unwrap_or(0.0).to_radians();
    Ok(Addition {
        scene: scene.into(),
        transform: Affine3A::from_scale_rotation_translation(
            Vec3::splat(scale),
            Quat::from_rotation_y(yaw),
            Vec3::new(values[0], values[1], values[2]),
        ),
        moving,
    })
}

/// Which part of the scene tracers hold.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Bounds {
    /// What suits the tracer; exact ones hold everything.
    Auto,
    /// Everything.
    Scene,
    /// What touches a box.
    Box(Aabb),
}

/// `auto`, `scene` or the box's six numbers.
pub(crate) fn bounds(text: &str) -> Result<Bounds, String> {
    match text {
        "auto" => Ok(Bounds::Auto),
        "scene" => Ok(Bounds::Scene),
        _ => numbers(text, 6..=6)
            .map(|v| Aabb {
                min: Vec3::new(v[0], v[1], v[2]),
                max: Vec3::new(v[3], v[4], v[5]),
            })
            .filter(|bounds| !bounds.is_empty())
            .map(Bounds::Box)
            .ok_or_else(|| {
                "expected auto, scene or X0,Y0,Z0,X1,Y1,Z1 in metres, the smaller corner first"
                    .into()
            }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes() {
        assert_eq!(size("640x480"), Ok([640, 480]));
        for wrong in [
            "",
            "640",
            "0x1",
            "1x0",
            "16385x1",
            "-1x1",
            "1x1x1",
            "99999999999x1",
        ] {
            assert!(size(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn distances_may_be_infinite() {
        assert_eq!(distance("inf"), Ok(f32::INFINITY));
        assert_eq!(distance("1.5"), Ok(1.5));
        for wrong in ["0", "-1", "nan", "1m"] {
            assert!(distance(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn materials_may_have_any_name() {
        let parsed = material("a=b,c=1,0.25").unwrap();
        assert_eq!((&parsed.name[..], parsed.roughness), ("a=b,c", 0.25));
        for wrong in ["a", "a=1", "a=1,2", "a=-1,0", "a=nan,0", "a=1,0,0"] {
            assert!(material(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn environments_are_colours_or_files() {
        let grey = EnvironmentChoice::Constant(Vec3::splat(0.5));
        assert_eq!(environment("0.5,0.5,0.5"), Ok(grey));
        let file = EnvironmentChoice::File("a,b.exr".into());
        assert_eq!(environment("a,b.exr"), Ok(file));
        assert!(environment("-1,0,0").is_err() && environment("").is_err());
    }

    #[test]
    fn additions_are_placed() {
        let added = addition("a@b.glb@1,2,3,2,90:moving").unwrap();
        assert_eq!((&added.scene[..], added.moving), ("a@b.glb", true));
        let point = added.transform.transform_point3(Vec3::Z);
        assert!(
            (point - Vec3::new(3.0, 2.0, 3.0)).length() < 1e-5,
            "{point}"
        );
        assert!(!addition("builtin:corner@0,0,0").unwrap().moving);
        for wrong in ["a.glb", "a.glb@1,2", "a.glb@1,2,3,0", "@1,2,3", "a@1,2,x"] {
            assert!(addition(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn boxes_have_an_inside() {
        assert_eq!(bounds("auto"), Ok(Bounds::Auto));
        assert!(matches!(bounds("0,0,0,1,1,1"), Ok(Bounds::Box(_))));
        for wrong in ["", "0,0,0,1,1", "1,0,0,0,1,1", "0,0,0,1,1,nan"] {
            assert!(bounds(wrong).is_err(), "{wrong}");
        }
    }
}
