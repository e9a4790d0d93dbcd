//! What the filters know about the surfaces in a picture, and how alike two pixels are.
//!
//! 1. [`Guides::new`] cleans normals and depths and finds how each pixel's tangent plane runs on beside it.
//! 2. [`EdgeStop`] makes a weight of the normals and depths of two pixels: 1 on one smooth surface, 0 across an edge.

use std::ops::RangeInclusive;

use rayon::prelude::*;

use crate::{
    ImageView, Pinhole, Result,
    camera::dot,
    error::require,
    image::Rows,
    lanes::{LANES, Lanes, exp, load},
};

/// Depths of surfaces; everything else is background.
const DEPTHS: RangeInclusive<f32> = 1e-30..=1e30;
/// Surfaces that are seen at a flatter angle, as a cosine, are taken to be seen at this one.
const FLATTEST: f32 = 0.05;
/// The inverse depth of a pixel outside the picture; 0 is that of one that sees no surface.
const OUTSIDE: f32 = -1.0;
/// Cosines up to this are taken as 0, so that no sum of weights is too small to divide by.
const GRAZING: f32 = 1e-6;
/// Channels of a pixel's guide: the normal, the inverse depth and its slopes.
const CHANNELS: usize = 6;

/// Normals and depths of a picture, prepared for the filters. Made once per picture and used by all of them.
///
/// The filters compare the depth of a pixel q with that of the tangent plane of pixel p rather than with p's, so that
/// a floor seen at a grazing angle is one surface. The inverse depth of a plane is linear in the picture:
///
/// ```text
/// ẑ⁻¹(p, q) = z⁻¹(p) · (1 + a·Δx + b·Δy), a = s · N·right / N·D, b = −s · N·up / N·D, s = 2 tan(yfov/2) / height
/// ```
///
/// with N the normal and D the viewing direction at p, scaled to depth 1. For a parallel camera, pass a pinhole far
/// behind it with a small opening, and depths from there.
///
/// Takes 24 bytes a pixel, and to make it about 40 operations.
#[derive(Clone, Debug, PartialEq)]
pub struct Guides {
    /// Normal x, y, z; 1/z; a and b.
    pub(crate) rows: Rows,
}

impl Guides {
    /// Prepares `normals` (three channels, of any length but 0, in the space of the camera's axes) and `depths` (one
    /// channel: the distance along the viewing direction, in any unit) of what `camera` sees through the centres of
    /// its pixels.
    ///
    /// A pixel sees a surface if its depth lies between 10⁻³⁰ and 10³⁰ and its normal is finite and not 0. All others
    /// are background; they match each other and no surface.
    ///
    /// # Errors
    /// [`Error::Size`](crate::Error::Size) when the images do not fit together.
    pub fn new(normals: ImageView<'_>, depths: ImageView<'_>, camera: &Pinhole) -> Result<Self> {
        let [width, height, _] = depths.size();
        depths.expect_size("the depths", [width, height, 1])?;
        normals.expect_size("the normals", [width, height, 3])?;
        let mut rows = Rows::new(width, height, CHANNELS);
        rows.rows_mut()
            .zip(normals.data().par_chunks_exact(3 * width))
            .zip(depths.data().par_chunks_exact(width))
            .enumerate()
            .for_each(|(y, ((row, normals), depths))| {
                for (x, (normal, &depth)) in normals.chunks_exact(3).zip(depths).enumerate() {
                    let guide = prepare(normal, depth, camera, [x, y], [width, height]);
                    for (channel, value) in guide.into_iter().enumerate() {
                        row[channel * width + x] = value;
                    }
                }
            });
        Ok(Self { rows })
    }

    /// Pixels in a row.
    pub const fn width(&self) -> usize {
        self.rows.width
    }

    /// Rows.
    pub const fn height(&self) -> usize {
        self.rows.height
    }

    /// An error unless an image is as wide and high.
    pub(crate) fn expect_size(&self, what: &'static str, image: ImageView<'_>) -> Result<()> {
        image.expect_size(what, [self.width(), self.height(), image.channels()])
    }

    /// All channels of a pixel.
    pub(crate) fn at(&self, x: usize, y: usize) -> [f32; CHANNELS] {
        let first = y * CHANNELS * self.rows.width + x;
        std::array::from_fn(|channel| self.rows.data[first + channel * self.rows.width])
    }
}

/// 1/z of a surface, 0 of background.
pub(crate) fn inverse_depth(depth: f32) -> f32 {
    if DEPTHS.contains(&depth) {
        1.0 / depth
    } else {
        0.0
    }
}

/// All channels of a pixel; zeros where it sees no surface.
fn prepare(
    normal: &[f32],
    depth: f32,
    camera: &Pinhole,
    [x, y]: [usize; 2],
    size: [usize; 2],
) -> [f32; CHANNELS] {
    let inverse = inverse_depth(depth);
    // In f64, no square of an f32 overflows or vanishes.
    let normal = [normal[0], normal[1], normal[2]].map(f64::from);
    let length = normal.iter().map(|value| value * value).sum::<f64>().sqrt();
    if !(inverse > 0.0 && length > 0.0 && length.is_finite()) {
        return [0.0; CHANNELS];
    }
    let normal = normal.map(|value| (value / length) as f32);
    let facing = dot(normal, camera.ray([x as f32 + 0.5, y as f32 + 0.5], size));
    let facing = facing.abs().max(FLATTEST).copysign(facing);
    let scale = 2.0 * camera.tan_half_yfov / (size[1] as f32 * facing);
    let [nx, ny, nz] = normal;
    let right = scale * dot(normal, camera.right);
    let down = -scale * dot(normal, camera.up);
    [nx, ny, nz, inverse, right, down]
}

/// How the angle between two normals counts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum NormalWeight {
    /// The cosine, 0 where it is negative: MS10 Eq. (2). It falls slowly: at 60° the weight is still one half.
    Cosine,
    /// e^(−(1 − cos θ) / (1 − cos θ₀)), the Gaussian in the difference of the normals of Dammertz et al. 2010,
    /// written with the angle θ₀ in radians, 0.01 to π, at which the weight has fallen to 1/e.
    Angle(f32),
}

/// Where filters stop: the weight of pixel q for pixel p is
///
/// ```text
/// w(p, q) = n(θ) · e^(−|z⁻¹(q) − ẑ⁻¹(p, q)| / (d · z⁻¹(p)))
/// ```
///
/// with θ the angle between the normals, n the [`NormalWeight`], z⁻¹ the inverse depth, ẑ⁻¹(p, q) that of p's tangent
/// plane at q (see [`Guides`]) and d the relative distance from that plane at which the weight has fallen to 1/e.
/// Two pixels of the background have weight 1, a surface and the background 0.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EdgeStop {
    pub(crate) normals: NormalWeight,
    pub(crate) depth: f32,
}

impl EdgeStop {
    /// The weight of MS10 Eq. (2): the cosine between the normals, whatever the depths.
    pub const COSINE: Self = Self {
        normals: NormalWeight::Cosine,
        depth: f32::INFINITY,
    };

    /// Stops by normals and by `depth`, the relative difference from the tangent plane at which the weight has
    /// fallen to 1/e: at least 10⁻⁴; infinite to ignore depths.
    ///
    /// # Errors
    /// [`Error::Parameter`](crate::Error::Parameter) when a parameter is out of its range.
    pub fn new(normals: NormalWeight, depth: f32) -> Result<Self> {
        if let NormalWeight::Angle(angle) = normals {
            require(
                (0.01..=std::f32::consts::PI).contains(&angle),
                "the angle between normals",
                angle,
                "it must be 0.01 to π radians",
            )?;
        }
        require(
            depth >= 1e-4,
            "the relative difference of depths",
            depth,
            "it must be at least 0.0001; infinity ignores depths",
        )?;
        Ok(Self { normals, depth })
    }
}

impl Default for EdgeStop {
    /// 15° and 1 %, found to upsample interiors best.
    fn default() -> Self {
        Self {
            normals: NormalWeight::Angle(15_f32.to_radians()),
            depth: 0.01,
        }
    }
}

/// [`EdgeStop`] as kernels use it: w = max(0, cos θ)^`cosine` · e^(`exponent`).
#[derive(Clone, Copy)]
pub(crate) struct EdgeKernel {
    pub(crate) cosine: bool,
    pub(crate) per_normal: f32,
    pub(crate) per_depth: f32,
}

impl From<EdgeStop> for EdgeKernel {
    fn from(stop: EdgeStop) -> Self {
        Self {
            cosine: stop.normals == NormalWeight::Cosine,
            per_normal: match stop.normals {
                NormalWeight::Cosine => 0.0,
                NormalWeight::Angle(angle) => (1.0 / (1.0 - f64::from(angle).cos())) as f32,
            },
            per_depth: 1.0 / stop.depth,
        }
    }
}

/// The guides of the pixels that a kernel is computing.
pub(crate) struct Here {
    normal: [Lanes; 3],
    inverse_depth: Lanes,
    slope: [Lanes; 2],
    /// The depth, 0 for background.
    depth: Lanes,
}

/// The guides of the pixels they are compared with.
pub(crate) struct There {
    normal: [Lanes; 3],
    inverse_depth: Lanes,
}

/// How alike pixels are.
pub(crate) struct Likeness {
    /// Whether both are surfaces or both background, and both inside the picture.
    pub(crate) same_kind: [bool; LANES],
    /// cos θ; 1 for background.
    pub(crate) cosine: Lanes,
    /// How far the second lies from the tangent plane of the first, relative to the depth.
    pub(crate) distance: Lanes,
}

impl Here {
    /// The pixels from (`x`, `y`) on.
    #[inline(always)]
    pub(crate) fn load(guides: &Rows, x: usize, y: usize) -> Self {
        let lanes = |channel| match guides.row(y as isize, channel) {
            Some(row) => load(row, x as isize, 0.0),
            None => [0.0; LANES],
        };
        Self::of([0, 1, 2, 3, 4, 5].map(lanes))
    }

    /// From the channels of guides.
    #[inline(always)]
    pub(crate) fn of(channels: [Lanes; CHANNELS]) -> Self {
        let [nx, ny, nz, inverse_depth, right, down] = channels;
        let mut depth = [0.0; LANES];
        for lane in 0..LANES {
            let inverse = inverse_depth[lane];
            depth[lane] = if inverse > 0.0 { 1.0 / inverse } else { 0.0 };
        }
        Self {
            normal: [nx, ny, nz],
            inverse_depth,
            slope: [right, down],
            depth,
        }
    }

    /// Compares with pixels that lie `dx` to the right and `dy` down.
    #[inline(always)]
    pub(crate) fn likeness(&self, there: &There, dx: f32, dy: f32) -> Likeness {
        let mut likeness = Likeness {
            same_kind: [false; LANES],
            cosine: [0.0; LANES],
            distance: [0.0; LANES],
        };
        for lane in 0..LANES {
            let (inverse, other) = (self.inverse_depth[lane], there.inverse_depth[lane]);
            let background = inverse == 0.0 && other == 0.0;
            likeness.same_kind[lane] = background || (inverse > 0.0 && other > 0.0);
            let cosine = self.normal[0][lane] * there.normal[0][lane]
                + self.normal[1][lane] * there.normal[1][lane]
                + self.normal[2][lane] * there.normal[2][lane];
            likeness.cosine[lane] = if background { 1.0 } else { cosine };
            let plane = 1.0 + self.slope[0][lane] * dx + self.slope[1][lane] * dy;
            let distance = (other * self.depth[lane] - plane).abs();
            // Bounded, so that it is 0 and not NaN times a weight that ignores depths.
            likeness.distance[lane] = if background { 0.0 } else { distance.min(1e30) };
        }
        likeness
    }
}

impl There {
    /// The pixels from `x` on in row `y`, all of which may lie outside.
    #[inline(always)]
    pub(crate) fn load(guides: &Rows, x: isize, y: isize) -> Option<Self> {
        Self::load_with(guides, y, |row, outside| load(row, x, outside))
    }

    /// Pixels of row `y` that `load` takes out of it, with the value for those outside.
    #[inline(always)]
    pub(crate) fn load_with(
        guides: &Rows,
        y: isize,
        load: impl Fn(&[f32], f32) -> Lanes,
    ) -> Option<Self> {
        let lanes = |channel, outside| Some(load(guides.row(y, channel)?, outside));
        Some(Self {
            normal: [lanes(0, 0.0)?, lanes(1, 0.0)?, lanes(2, 0.0)?],
            inverse_depth: lanes(3, OUTSIDE)?,
        })
    }
}

impl There {
    /// 1 for pixels inside the picture, else 0.
    #[inline(always)]
    pub(crate) fn inside(&self) -> Lanes {
        self.inverse_depth
            .map(|inverse| if inverse >= 0.0 { 1.0 } else { 0.0 })
    }
}

impl EdgeKernel {
    /// The exponent and the factor of the weights; `cosine` is a number of its own where θ counts as Eq. (2) has it.
    #[inline(always)]
    pub(crate) fn parts(&self, likeness: &Likeness) -> (Lanes, Lanes) {
        let (mut exponent, mut factor) = ([0.0; LANES], [0.0; LANES]);
        for lane in 0..LANES {
            let cosine = likeness.cosine[lane];
            let weight = if self.cosine { cosine } else { 1.0 };
            let counts = likeness.same_kind[lane] & (weight > GRAZING);
            factor[lane] = if counts { weight } else { 0.0 };
            exponent[lane] = -(self.per_normal * (1.0 - cosine).max(0.0)
                + self.per_depth * likeness.distance[lane]);
        }
        (exponent, factor)
    }

    /// The weights.
    #[inline(always)]
    pub(crate) fn weights(&self, likeness: &Likeness) -> Lanes {
        let (exponent, factor) = self.parts(likeness);
        let mut weights = [0.0; LANES];
        for lane in 0..LANES {
            weights[lane] = factor[lane] * exp(exponent[lane]);
        }
        weights
    }
}
