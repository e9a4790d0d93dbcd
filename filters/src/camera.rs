//! The camera that saw a picture.

use crate::{Result, error::require};

/// A pinhole camera: where it stands, its axes and its opening. The aspect ratio is that of the picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pinhole {
    pub(crate) position: [f32; 3],
    pub(crate) right: [f32; 3],
    pub(crate) up: [f32; 3],
    pub(crate) forward: [f32; 3],
    pub(crate) tan_half_yfov: f32,
}

impl Pinhole {
    /// A camera at `position` with the axes to the `right` of the picture, `up` to its top and `forward` into it, each
    /// of length 1 and at right angles to the others, and the vertical opening angle `yfov` in radians, 0.001 to 3.1.
    ///
    /// # Errors
    /// [`Error::Parameter`](crate::Error::Parameter) when the position is not finite, the axes are not as described
    /// within 1 %, or the angle is out of its range.
    pub fn new(position: [f32; 3], [right, up, forward]: [[f32; 3]; 3], yfov: f32) -> Result<Self> {
        require(
            position.iter().all(|value| value.is_finite()),
            "the camera's position",
            format!("{position:?}"),
            "it must be finite",
        )?;
        let axes = [right, up, forward];
        let products = (0..3).flat_map(|i| (0..=i).map(move |j| (i, j)));
        let mut errors = products.map(|(i, j)| (dot(axes[i], axes[j]) - f32::from(i == j)).abs());
        require(
            errors.all(|error| error <= 0.01),
            "the camera's axes",
            format!("{axes:?}"),
            "they must have length 1 and be at right angles",
        )?;
        require(
            (0.001..=3.1).contains(&yfov),
            "the camera's vertical opening",
            yfov,
            "it must be 0.001 to 3.1 radians",
        )?;
        Ok(Self {
            position,
            right,
            up,
            forward,
            tan_half_yfov: (0.5 * yfov).tan(),
        })
    }

    /// A camera at the origin that looks along −z, +y to the top: for normals in the camera's own space.
    ///
    /// # Errors
    /// As [`new`](Self::new).
    pub fn at_origin(yfov: f32) -> Result<Self> {
        let axes = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, -1.0]];
        Self::new([0.0; 3], axes, yfov)
    }

    /// The direction through a place in a picture of `[width, height]` pixels, its part along `forward` 1.
    pub(crate) fn ray(&self, at: [f32; 2], size: [usize; 2]) -> [f32; 3] {
        let [width, height] = size.map(|side| side as f32);
        let right = (2.0 * at[0] - width) / height * self.tan_half_yfov;
        let up = (height - 2.0 * at[1]) / height * self.tan_half_yfov;
        std::array::from_fn(|axis| {
            self.forward[axis] + right * self.right[axis] + up * self.up[axis]
        })
    }

    /// The place in a picture of `[width, height]` pixels of a point relative to the camera, and its depth. `None`
    /// behind the camera.
    pub(crate) fn project(&self, point: [f32; 3], size: [usize; 2]) -> Option<[f32; 3]> {
        let [width, height] = size.map(|side| side as f32);
        let depth = dot(point, self.forward);
        if depth.is_nan() || depth <= 0.0 {
            return None;
        }
        let scale = 0.5 * height / (self.tan_half_yfov * depth);
        let x = 0.5 * width + dot(point, self.right) * scale;
        let y = 0.5 * height - dot(point, self.up) * scale;
        Some([x, y, depth])
    }
}

#[inline(always)]
pub(crate) fn dot(a: [f32; 3], b: [f32; 3]) -> f32 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}
