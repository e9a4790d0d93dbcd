//! Images: the view that callers pass, and the layout that kernels work in.

use rayon::prelude::*;

use crate::{Error, Result, error::require};

/// Largest width and height of an image, so that every pixel's position is exact in `f32`.
pub const MAX_SIDE: usize = 1 << 16;

/// A picture of `f32` numbers that someone else owns.
///
/// Pixels lie row by row from the top, the channels of a pixel beside each other: the number of channel `c` at
/// (`x`, `y`) is `data[(y · width + x) · channels + c]`. A planar picture is one view of one channel per plane.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ImageView<'a> {
    data: &'a [f32],
    width: usize,
    height: usize,
    channels: usize,
}

impl<'a> ImageView<'a> {
    /// A view of a slice.
    ///
    /// # Errors
    /// [`Error::Parameter`] for a side of 0 or above [`MAX_SIDE`] or no channels, [`Error::Length`] when the slice
    /// is too short or too long.
    pub fn new(data: &'a [f32], width: usize, height: usize, channels: usize) -> Result<Self> {
        let sides = "it must be 1 to 65536";
        require(
            (1..=MAX_SIDE).contains(&width),
            "an image's width",
            width,
            sides,
        )?;
        require(
            (1..=MAX_SIDE).contains(&height),
            "an image's height",
            height,
            sides,
        )?;
        require(
            channels > 0 && width.checked_mul(height * channels).is_some(),
            "the number of an image's channels",
            channels,
            "it must be at least 1, and all of the image's numbers must be countable",
        )?;
        let view = Self {
            data,
            width,
            height,
            channels,
        };
        check_length("an image", data, view.size())?;
        Ok(view)
    }

    /// A view of a slice that has been checked.
    pub(crate) fn trusted(data: &'a [f32], width: usize, height: usize, channels: usize) -> Self {
        debug_assert_eq!(data.len(), width * height * channels);
        Self {
            data,
            width,
            height,
            channels,
        }
    }

    /// The numbers.
    pub const fn data(&self) -> &'a [f32] {
        self.data
    }

    /// Pixels in a row.
    pub const fn width(&self) -> usize {
        self.width
    }

    /// Rows.
    pub const fn height(&self) -> usize {
        self.height
    }

    /// Numbers per pixel.
    pub const fn channels(&self) -> usize {
        self.channels
    }

    /// Width, height and channels.
    pub const fn size(&self) -> [usize; 3] {
        [self.width, self.height, self.channels]
    }

    /// An error unless width, height and channels are the given ones.
    pub(crate) fn expect_size(&self, what: &'static str, expected: [usize; 3]) -> Result<()> {
        if self.size() == expected {
            return Ok(());
        }
        Err(Error::Size {
            what,
            expected,
            found: self.size(),
        })
    }
}

/// An error unless a slice holds an image of `[width, height, channels]`.
pub(crate) fn check_length(what: &'static str, data: &[f32], size: [usize; 3]) -> Result<()> {
    let [width, height, channels] = size;
    let expected = width * height * channels;
    if data.len() == expected {
        return Ok(());
    }
    Err(Error::Length {
        what,
        width,
        height,
        channels,
        expected,
        found: data.len(),
    })
}

/// A picture with each row's channels in planes of their own: all of the first, then all of the second, …
///
/// Neighbours of one channel lie beside each other, as SIMD wants them, and a row is one piece of memory, as
/// threads want it.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Rows {
    pub(crate) data: Vec<f32>,
    pub(crate) width: usize,
    pub(crate) height: usize,
    pub(crate) channels: usize,
}

impl Rows {
    pub(crate) fn new(width: usize, height: usize, channels: usize) -> Self {
        Self {
            data: vec![0.0; width * height * channels],
            width,
            height,
            channels,
        }
    }

    pub(crate) fn of(image: ImageView<'_>) -> Self {
        let [width, height, channels] = image.size();
        let mut rows = Self::new(width, height, channels);
        rows.rows_mut()
            .zip(image.data.par_chunks_exact(width * channels))
            .for_each(|(row, pixels)| separate(pixels, row, channels));
        rows
    }

    /// One channel of a row; `None` above and below the image.
    #[inline(always)]
    pub(crate) fn row(&self, y: isize, channel: usize) -> Option<&[f32]> {
        let y = usize::try_from(y).ok().filter(|&y| y < self.height)?;
        let start = (y * self.channels + channel) * self.width;
        Some(&self.data[start..start + self.width])
    }

    /// All channels of a row, one after the other.
    pub(crate) fn rows_mut(&mut self) -> impl IndexedParallelIterator<Item = &mut [f32]> {
        self.data.par_chunks_exact_mut(self.width * self.channels)
    }

    /// Writes the picture with the channels of each pixel beside each other.
    pub(crate) fn interleave(&self, output: &mut [f32]) {
        let length = self.width * self.channels;
        output
            .par_chunks_exact_mut(length)
            .zip(self.data.par_chunks_exact(length))
            .for_each(|(pixels, row)| interleave(row, pixels, self.channels));
    }
}

/// Pixels to planes, one row.
pub(crate) fn separate(pixels: &[f32], row: &mut [f32], channels: usize) {
    let width = row.len() / channels;
    for (channel, plane) in row.chunks_exact_mut(width).enumerate() {
        for (to, pixel) in plane.iter_mut().zip(pixels.chunks_exact(channels)) {
            *to = pixel[channel];
        }
    }
}

/// Planes to pixels, one row.
pub(crate) fn interleave(row: &[f32], pixels: &mut [f32], channels: usize) {
    let width = row.len() / channels;
    for (channel, plane) in row.chunks_exact(width).enumerate() {
        for (from, pixel) in plane.iter().zip(pixels.chunks_exact_mut(channels)) {
            pixel[channel] = *from;
        }
    }
}
