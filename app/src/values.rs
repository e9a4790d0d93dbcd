//! Parsers of the command line's values: what is out of range is refused with the range.

use glam::{Affine3A, Mat3A, Quat, Vec3, Vec3A};
use isophote_scene::{Aabb, Camera, Projection};

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

/// Two sides of a tile, `MxN`, 1 to 8 each.
pub(crate) fn tile(text: &str) -> Result<[u32; 2], String> {
    let sides = text.split_once('x').and_then(|(m, n)| {
        let side = |text: &str| text.parse().ok().filter(|side| (1..=8).contains(side));
        Some([side(m)?, side(n)?])
    });
    sides.ok_or_else(|| "expected two sides of 1 to 8, like 3x3".into())
}

/// The side of a shadow map.
pub(crate) fn map_side(text: &str) -> Result<u32, String> {
    text.parse()
        .ok()
        .filter(|side: &u32| (8..=1024).contains(side) && side.is_multiple_of(8))
        .ok_or_else(|| "expected a multiple of 8 from 8 to 1024".into())
}

/// A bias of shadow maps.
pub(crate) fn bias(text: &str) -> Result<f32, String> {
    number(text, "a number of texels from 0 to 16", |value| {
        (0.0..=16.0).contains(&value)
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

/// How far from fast to exact.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Dial {
    /// Answers less sure than this are asked for again.
    Sureness(f32),
    /// About this share of the rays, the least sure ones; 0 to 1.
    Share(f32),
}

/// A [`Dial`]: `0.7`, or `15%`.
pub(crate) fn dial(text: &str) -> Result<Dial, String> {
    let parsed = match text.strip_suffix('%') {
        Some(percent) => not_negative(percent)
            .ok()
            .filter(|percent| *percent <= 100.0)
            .map(|percent| Dial::Share(percent / 100.0)),
        None => not_negative(text).ok().map(Dial::Sureness),
    };
    parsed.ok_or_else(|| {
        "expected a sureness of at least 0 such as 0.7, or a share from 0% to 100%".into()
    })
}

/// 1 or 4.
pub(crate) fn one_or_four(text: &str) -> Result<u32, String> {
    match text {
        "1" => Ok(1),
        "4" => Ok(4),
        _ => Err("expected 1 or 4".into()),
    }
}

/// A standard deviation in pixels.
pub(crate) fn sigma(text: &str) -> Result<f32, String> {
    number(text, "a number from 0.1 to 1000", |value| {
        (0.1..=1000.0).contains(&value)
    })
}

/// A mip level.
pub(crate) fn level(text: &str) -> Result<f32, String> {
    number(text, "a number from 0 to 32", |value| {
        (0.0..=32.0).contains(&value)
    })
}

/// An odd number of pixels.
pub(crate) fn odd(text: &str) -> Result<u32, String> {
    text.parse()
        .ok()
        .filter(|width| width % 2 == 1 && (1..=1023).contains(width))
        .ok_or_else(|| "expected an odd number from 1 to 1023".into())
}

/// `NAME=metallic,roughness[,r,g,b]`.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct MaterialOverride {
    /// The name of a material in the file, or of an object.
    pub(crate) name: String,
    /// 0..=1.
    pub(crate) metallic: f32,
    /// 0..=1.
    pub(crate) roughness: f32,
    /// Linear RGB, 0..=1.
    pub(crate) base_color: Option<Vec3>,
}

/// Parses a [`MaterialOverride`].
pub(crate) fn material(text: &str) -> Result<MaterialOverride, String> {
    text.rsplit_once('=')
        .and_then(|(name, values)| Some((name, numbers(values, 2..=5)?)))
        .filter(|(_, values)| values.len() != 3 && values.len() != 4)
        .filter(|(_, values)| values.iter().all(|value| (0.0..=1.0).contains(value)))
        .map(|(name, values)| MaterialOverride {
            name: name.into(),
            metallic: values[0],
            roughness: values[1],
            base_color: values.get(2..5).map(Vec3::from_slice),
        })
        .ok_or_else(|| {
            "expected NAME=METALLIC,ROUGHNESS[,R,G,B], all within 0..1, such as Gold=1,0.2".into()
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

/// `FILE[#OBJECT]@x,y,z[,scale[,yaw]][:moving]`.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Addition {
    /// A scene file or `builtin:NAME`.
    pub(crate) scene: String,
    /// The name of the objects to take from it; all unless given.
    pub(crate) object: Option<String>,
    /// Where it goes.
    pub(crate) transform: Affine3A,
    /// Whether precomputed structures must leave it out.
    pub(crate) moving: bool,
}

/// Parses an [`Addition`].
pub(crate) fn addition(text: &str) -> Result<Addition, String> {
    let expected = "expected FILE[#OBJECT]@X,Y,Z[,SCALE[,YAW]][:moving] in metres and degrees, such as bunny.glb@0,1,0";
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
    let (scene, object) = match scene.rsplit_once('#') {
        Some((scene, object)) => (scene, Some(object.into())),
        None => (scene, None),
    };
    Ok(Addition {
        scene: scene.into(),
        object,
        transform: Affine3A::from_scale_rotation_translation(
            Vec3::splat(scale),
            Quat::from_rotation_y(yaw),
            Vec3::new(values[0], values[1], values[2]),
        ),
        moving,
    })
}

/// How a light or an object is moved.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Shift {
    /// Of the light or object.
    pub(crate) name: String,
    /// Metres.
    pub(crate) offset: Vec3,
    /// About +Y where it is, after the pitch; radians.
    pub(crate) yaw: f32,
    /// About its own X axis, radians.
    pub(crate) pitch: f32,
}

/// Parses a [`Shift`].
pub(crate) fn shift(text: &str) -> Result<Shift, String> {
    text.rsplit_once('=')
        .and_then(|(name, values)| Some((name, numbers(values, 3..=5)?)))
        .map(|(name, values)| Shift {
            name: name.into(),
            offset: Vec3::from_slice(&values),
            yaw: values.get(3).map_or(0.0, |degrees| degrees.to_radians()),
            pitch: values.get(4).map_or(0.0, |degrees| degrees.to_radians()),
        })
        .ok_or_else(|| {
            "expected NAME=X,Y,Z[,YAW[,PITCH]] in metres and degrees, such as Lamp=0,0.5,0".into()
        })
}

impl Shift {
    /// Where it takes something.
    pub(crate) fn of(&self, place: Affine3A) -> Affine3A {
        let (yaw, pitch) = (
            Mat3A::from_rotation_y(self.yaw),
            Mat3A::from_rotation_x(self.pitch),
        );
        Affine3A {
            matrix3: yaw * place.matrix3 * pitch,
            translation: place.translation + Vec3A::from(self.offset),
        }
    }
}

/// A camera by numbers: where it stands, what it looks at, and how far it opens vertically, in degrees (50 unless given) or,
/// where its rays are parallel, as the height of what is seen in metres (`3m`).
pub(crate) fn viewpoint(text: &str) -> Option<Camera> {
    let (text, height) = match text
        .strip_suffix('m')
        .and_then(|text| text.rsplit_once(','))
    {
        Some((text, height)) => (text, Some(finite(height).ok()?)),
        None => (text, None),
    };
    let values = numbers(text, 6..=if height.is_some() { 6 } else { 7 })?;
    let (eye, target) = (Vec3::from_slice(&values), Vec3::from_slice(&values[3..]));
    let degrees = values.get(6).copied().unwrap_or(50.0);
    let opens = degrees > 0.0 && degrees < 180.0 && height.is_none_or(|height| height > 0.0);
    let mut camera = Camera::look_at(text, eye, target, degrees.to_radians());
    if let Some(height) = height {
        let half_height = 0.5 * height;
        camera.projection = Projection::Orthographic { half_height };
    }
    (opens && eye != target).then_some(camera)
}

/// Which part of the scene tracers hold.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Bounds {
    All,
    /// What touches a box.
    Box(Aabb),
}

/// `all` or the box's six numbers.
pub(crate) fn bounds(text: &str) -> Result<Bounds, String> {
    match text {
        // The others stand in headers of older files.
        "all" | "auto" | "scene" => Ok(Bounds::All),
        _ => numbers(text, 6..=6)
            .map(|v| Aabb {
                min: Vec3::new(v[0], v[1], v[2]),
                max: Vec3::new(v[3], v[4], v[5]),
            })
            .filter(|bounds| !bounds.is_empty())
            .map(Bounds::Box)
            .ok_or_else(|| {
                "expected all or X0,Y0,Z0,X1,Y1,Z1 in metres, the smaller corner first".into()
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
        let blue = material("a=0,1,0,0,0.5").unwrap();
        assert_eq!(blue.base_color, Some(Vec3::new(0.0, 0.0, 0.5)));
        for wrong in ["a", "a=1", "a=1,2", "a=-1,0", "a=nan,0", "a=1,0,0"] {
            assert!(material(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn dials_are_surenesses_or_shares() {
        assert_eq!(dial("0.7"), Ok(Dial::Sureness(0.7)));
        assert_eq!(dial("15%"), Ok(Dial::Share(0.15)));
        for wrong in ["", "%", "101%", "-1", "-1%", "inf", "nan"] {
            assert!(dial(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn widths_are_odd() {
        assert_eq!(odd("11"), Ok(11));
        for wrong in ["0", "2", "-1", "1025", "x"] {
            assert!(odd(wrong).is_err(), "{wrong}");
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
        let one = addition("a#b@0,0,0").unwrap();
        assert_eq!((&one.scene[..], one.object.as_deref()), ("a", Some("b")));
        for wrong in ["a.glb", "a.glb@1,2", "a.glb@1,2,3,0", "@1,2,3", "a@1,2,x"] {
            assert!(addition(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn lights_and_objects_are_moved_and_turned() {
        let moved = shift("a=b=1,2,3,90").unwrap();
        assert_eq!((&moved.name[..], moved.pitch), ("a=b", 0.0));
        let place = Affine3A::from_translation(Vec3::X);
        let placed = moved.of(place).transform_point3(Vec3::Z);
        assert!(
            (placed - Vec3::new(3.0, 2.0, 3.0)).length() < 1e-5,
            "{placed}"
        );
        let tipped = shift("a=0,0,0,0,-90").unwrap().of(place);
        let down = tipped.transform_vector3(Vec3::NEG_Z);
        assert!((down - Vec3::NEG_Y).length() < 1e-5, "{down}");
        for wrong in ["a", "a=1,2", "a=1,2,x", "a=1,2,3,4,5,6"] {
            assert!(shift(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn viewpoints_are_numbers() {
        let camera = viewpoint("1,2,3,1,2,-7,40").unwrap();
        assert_eq!(camera.position(), Vec3::new(1.0, 2.0, 3.0));
        assert_eq!(-camera.transform.matrix3.z_axis, Vec3A::NEG_Z);
        let yfov = 40_f32.to_radians();
        assert_eq!(camera.projection, Projection::Perspective { yfov });
        let parallel = viewpoint("0,0,0,0,0,-1,3m").unwrap().projection;
        assert_eq!(parallel, Projection::Orthographic { half_height: 1.5 });
        for wrong in [
            "Camera",
            "1,2,3",
            "0,0,0,0,0,0",
            "0,0,0,0,0,1,0",
            "0,0,0,0,0,1,180",
            "0,0,0,0,0,1,5,3m",
            "0,0,0,0,0,1,0m",
            "é",
        ] {
            assert!(viewpoint(wrong).is_none(), "{wrong}");
        }
    }

    #[test]
    fn boxes_have_an_inside() {
        for all in ["all", "auto", "scene"] {
            assert_eq!(bounds(all), Ok(Bounds::All));
        }
        assert!(matches!(bounds("0,0,0,1,1,1"), Ok(Bounds::Box(_))));
        for wrong in ["", "0,0,0,1,1", "1,0,0,0,1,1", "0,0,0,1,1,nan"] {
            assert!(bounds(wrong).is_err(), "{wrong}");
        }
    }
}
