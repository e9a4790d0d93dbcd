//! 8-bit textures with mip chains, filtered in linear light.

use glam::{IVec2, Vec2, Vec4};

/// An RGBA texture with its whole mip chain, 8 bits a channel.
#[derive(Clone, Debug, PartialEq)]
pub struct Texture {
    /// The name in the file; may be empty.
    pub name: String,
    /// How the stored RGB is to be read; alpha is always linear.
    pub color_space: ColorSpace,
    /// What happens outside 0..1, in u and v.
    pub wrap: [Wrap; 2],
    /// Whether neighbouring texels are interpolated.
    pub filter: Filter,
    /// Level 0 is the image; each further one has half the size, rounded down, until 1×1.
    levels: Vec<Level>,
}

/// How stored texels become numbers to calculate with.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum ColorSpace {
    /// IEC 61966-2-1, as for base colours and emission.
    Srgb,
    /// Value / 255, as for everything else.
    Linear,
}

/// What a texture shows outside 0..1.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Wrap {
    /// The image again.
    #[default]
    Repeat,
    /// The image mirrored, then again.
    Mirror,
    /// The texels of the edge.
    Clamp,
}

/// How a texture is read between its texels.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Filter {
    /// The nearest texel.
    Nearest,
    /// Bilinear within a level, linear between levels.
    #[default]
    Linear,
}

#[derive(Clone, Debug, PartialEq)]
struct Level {
    width: u32,
    height: u32,
    texels: Vec<[u8; 4]>,
}

impl Texture {
    /// Makes a texture with its mip chain of `width` × `height` texels, row by row from the top.
    ///
    /// # Panics
    /// If a side is 0 or the number of texels is not `width * height`.
    pub fn new(
        name: impl Into<String>,
        width: u32,
        height: u32,
        texels: Vec<[u8; 4]>,
        color_space: ColorSpace,
    ) -> Self {
        assert!(width > 0 && height > 0, "a texture has at least one texel");
        assert_eq!(
            texels.len(),
            width as usize * height as usize,
            "one entry per texel"
        );
        let mut levels = vec![Level {
            width,
            height,
            texels,
        }];
        while let Some(next) = levels[levels.len() - 1].half(color_space) {
            levels.push(next);
        }
        Self {
            name: name.into(),
            color_space,
            wrap: [Wrap::Repeat; 2],
            filter: Filter::Linear,
            levels,
        }
    }

    /// Width and height of level 0 in texels.
    pub fn size(&self) -> [u32; 2] {
        [self.levels[0].width, self.levels[0].height]
    }

    /// Number of mip levels, the image itself included.
    pub fn level_count(&self) -> usize {
        self.levels.len()
    }

    /// A level's width, height and stored texels.
    pub fn level(&self, level: usize) -> (u32, u32, &[[u8; 4]]) {
        let level = &self.levels[level];
        (level.width, level.height, &level.texels)
    }

    /// Bytes held by all levels.
    pub fn bytes(&self) -> usize {
        self.levels
            .iter()
            .map(|level| size_of_val(&level.texels[..]))
            .sum()
    }

    /// Linear RGBA at `uv`, (0, 0) being the top left; `lod` 0 is the full resolution, each further 1 halves it.
    pub fn sample(&self, uv: Vec2, lod: f32) -> Vec4 {
        let last = self.levels.len() - 1;
        let lod = if lod > 0.0 { lod.min(last as f32) } else { 0.0 };
        let fine = (lod.floor() as usize).min(last);
        let at =
            |level: usize| self.levels[level].sample(uv, self.wrap, self.filter, self.color_space);
        match self.filter {
            Filter::Nearest => at((lod.round() as usize).min(last)),
            Filter::Linear if lod == fine as f32 => at(fine),
            Filter::Linear => at(fine).lerp(at((fine + 1).min(last)), lod - fine as f32),
        }
    }
}

impl Level {
    fn sample(&self, uv: Vec2, wrap: [Wrap; 2], filter: Filter, color_space: ColorSpace) -> Vec4 {
        // NaN coordinates read the first texel.
        let uv = if uv.is_finite() { uv } else { Vec2::ZERO };
        let size = Vec2::new(self.width as f32, self.height as f32);
        let texel = |at: IVec2| {
            let x = wrap[0].index(at.x, self.width) as usize;
            let y = wrap[1].index(at.y, self.height) as usize;
            decode(self.texels[y * self.width as usize + x], color_space)
        };
        // Repeating before scaling keeps far-out coordinates within i32.
        let uv = Vec2::new(wrap[0].fold(uv.x), wrap[1].fold(uv.y)) * size;
        match filter {
            Filter::Nearest => texel(uv.floor().as_ivec2()),
            Filter::Linear => {
                let corner = (uv - 0.5).floor();
                let weight = uv - 0.5 - corner;
                let at = corner.as_ivec2();
                let top = texel(at).lerp(texel(at + IVec2::X), weight.x);
                let bottom = texel(at + IVec2::Y).lerp(texel(at + IVec2::ONE), weight.x);
                top.lerp(bottom, weight.y)
            }
        }
    }

    /// The next level of the mip chain, box-filtered in linear light, or `None` below 1×1.
    fn half(&self, color_space: ColorSpace) -> Option<Self> {
        if self.width == 1 && self.height == 1 {
            return None;
        }
        let (width, height) = ((self.width / 2).max(1), (self.height / 2).max(1));
        // An odd side's last texel is shared out over the level below by covering ranges.
        let covered = |i: u32, size: u32, whole: u32| {
            let [i, size, whole] = [i, size, whole].map(u64::from);
            (i * whole / size) as usize..((i + 1) * whole).div_ceil(size) as usize
        };
        let mut texels = Vec::with_capacity(width as usize * height as usize);
        for y in 0..height {
            let rows = covered(y, height, self.height);
            for x in 0..width {
                let columns = covered(x, width, self.width);
                let mut sum = Vec4::ZERO;
                for row in rows.clone() {
                    for column in columns.clone() {
                        sum += decode(self.texels[row * self.width as usize + column], color_space);
                    }
                }
                texels.push(encode(
                    sum / (rows.len() * columns.len()) as f32,
                    color_space,
                ));
            }
        }
        Some(Self {
            width,
            height,
            texels,
        })
    }
}

impl Wrap {
    /// Brings a coordinate near 0..1 without changing what it shows.
    fn fold(self, x: f32) -> f32 {
        match self {
            Self::Repeat => x - x.floor(),
            Self::Mirror => x - 2.0 * (x * 0.5).floor(),
            Self::Clamp => x.clamp(0.0, 1.0),
        }
    }

    fn index(self, i: i32, size: u32) -> i32 {
        let size = size as i32;
        match self {
            Self::Repeat => i.rem_euclid(size),
            Self::Mirror => {
                let i = i.rem_euclid(2 * size);
                if i < size { i } else { 2 * size - 1 - i }
            }
            Self::Clamp => i.clamp(0, size - 1),
        }
    }
}

/// The linear value of an sRGB value in 0..=1 (IEC 61966-2-1).
pub fn srgb_to_linear(value: f32) -> f32 {
    if value <= 0.04045 {
        value / 12.92
    } else {
        ((value + 0.055) / 1.055).powf(2.4)
    }
}

/// The sRGB value of a linear value in 0..=1 (IEC 61966-2-1).
pub fn linear_to_srgb(value: f32) -> f32 {
    if value <= 0.003_130_8 {
        value * 12.92
    } else {
        1.055 * value.powf(1.0 / 2.4) - 0.055
    }
}

fn decode(texel: [u8; 4], color_space: ColorSpace) -> Vec4 {
    static SRGB: std::sync::LazyLock<[f32; 256]> =
        std::sync::LazyLock::new(|| std::array::from_fn(|i| srgb_to_linear(i as f32 / 255.0)));
    let linear = |value: u8| f32::from(value) / 255.0;
    let [r, g, b, a] = texel;
    match color_space {
        ColorSpace::Linear => Vec4::new(linear(r), linear(g), linear(b), linear(a)),
        ColorSpace::Srgb => {
            let table = &*SRGB;
            Vec4::new(
                table[usize::from(r)],
                table[usize::from(g)],
                table[usize::from(b)],
                linear(a),
            )
        }
    }
}

fn encode(value: Vec4, color_space: ColorSpace) -> [u8; 4] {
    let byte = |value: f32| (value.clamp(0.0, 1.0) * 255.0 + 0.5) as u8;
    let color = |value: f32| match color_space {
        ColorSpace::Linear => byte(value),
        ColorSpace::Srgb => byte(linear_to_srgb(value)),
    };
    [
        color(value.x),
        color(value.y),
        color(value.z),
        byte(value.w),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn checker() -> Texture {
        let texels = vec![
            [255, 0, 0, 255],
            [0, 255, 0, 255],
            [0, 0, 255, 255],
            [255, 255, 255, 0],
        ];
        Texture::new("checker", 2, 2, texels, ColorSpace::Srgb)
    }

    #[test]
    fn mips_average_in_linear_light() {
        let texture = checker();
        assert_eq!(texture.level_count(), 2);
        let mean = texture.sample(Vec2::splat(0.3), 1.0);
        assert!(
            (mean - Vec4::new(0.5, 0.5, 0.5, 0.75)).abs().max_element() < 5e-3,
            "{mean}"
        );
    }

    #[test]
    fn mips_of_very_long_textures() {
        let texture = Texture::new("", 1, 70_001, vec![[8; 4]; 70_001], ColorSpace::Linear);
        assert_eq!(texture.level_count(), 17);
        assert_eq!(texture.level(16), (1, 1, &[[8; 4]][..]));
    }

    #[test]
    fn wrap_modes() {
        let mut texture = checker();
        texture.filter = Filter::Nearest;
        let red = Vec4::new(1.0, 0.0, 0.0, 1.0);
        let green = Vec4::new(0.0, 1.0, 0.0, 1.0);
        assert_eq!(texture.sample(Vec2::new(1.25, 0.25), 0.0), red);
        assert_eq!(texture.sample(Vec2::new(-0.25, 0.25), 0.0), green);
        texture.wrap = [Wrap::Mirror; 2];
        assert_eq!(texture.sample(Vec2::new(1.25, 0.25), 0.0), green);
        texture.wrap = [Wrap::Clamp; 2];
        assert_eq!(texture.sample(Vec2::new(7.25, -3.0), 0.0), green);
        assert!(texture.sample(Vec2::new(f32::NAN, 3e38), 0.0).is_finite());
    }
}
