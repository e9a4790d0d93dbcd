//! Fields in files, so that they are built once; coded without loss.
//!
//! ```text
//! header    96 bytes: how it was sampled, the sphere, of which mesh, how long the rest is
//! samples   deflated: a bit for each, whether it hits; and of those that do what is left after predicting them from hits to
//!           the left, above and beside that
//! ```
//!
//! in a [`Sealed`] file.

use std::{
    io::{Read, Write},
    path::Path,
};

use bytemuck::{Pod, Zeroable};
use flate2::{Compression, read::ZlibDecoder, write::ZlibEncoder};
use glam::Vec3;
use isophote_scene::sealed::Sealed;

use super::{
    field::Field,
    samples::{Bits, Samples},
};
use crate::{Directions, Error, FieldParams, Positions, Result, Sphere, Storage};

const FORMAT: Sealed = Sealed {
    magic: *b"ISOPHDFI",
    // 1 coded misses as distances.
    version: 2,
    what: "a displacement field",
    remedy: "build the field anew",
};

#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
struct Header {
    positions: [u32; 3],
    directions: u32,
    resolution: u32,
    bits: u32,
    center: [f32; 3],
    radius: f32,
    mesh: [u64; 2],
    /// Bytes of the coded samples.
    coded: u64,
    reserved: [u64; 4],
}

impl Field {
    /// Writes the field into a file, whole or not at all. Returns how many bytes that took.
    ///
    /// # Errors
    /// [`Error::Scene`] when the file cannot be written.
    pub fn save(&self, path: &Path) -> Result<u64> {
        let coded = self.coded();
        let header = self.header(coded.len() as u64);
        Ok(FORMAT.write(path, &header, &[&coded])?)
    }

    /// Reads a field that was [saved](Self::save). Whether it is of a mesh is told by [`is_of`](Self::is_of).
    ///
    /// # Errors
    /// [`Error::Scene`] with what [`Sealed::read`] returns, [`Error::TooLarge`] above `max_bytes`.
    pub fn load(path: &Path, max_bytes: u64) -> Result<Self> {
        let (header, coded) = FORMAT.read(path, |header: &Header| Ok(header.coded))?;
        let params = header.params(path, max_bytes)?;
        let sphere = Sphere {
            center: Vec3::from_array(header.center),
            radius: header.radius,
        };
        if !(sphere.center.is_finite() && sphere.radius > 0.0 && sphere.radius.is_finite()) {
            return Err(damaged(path, "its sphere has no extent"));
        }
        let samples = decoded(&coded, &params).map_err(|reason| damaged(path, reason))?;
        Ok(Self::new(params, sphere, header.mesh, samples))
    }

    /// Bytes of the samples when coded, as a file has them.
    pub fn coded_bytes(&self) -> usize {
        self.coded().len()
    }

    fn header(&self, coded: u64) -> Header {
        let params = &self.params;
        Header {
            positions: match params.positions {
                Positions::Slater { rings } => [0, rings, 0],
                Positions::Spherical { rows, columns } => [1, rows, columns],
                Positions::Octahedral { side } => [2, side, 0],
            },
            directions: params.directions as u32,
            resolution: params.resolution,
            bits: params.storage.bits(),
            center: self.sphere.center.to_array(),
            radius: self.sphere.radius,
            mesh: self.mesh_key,
            coded,
            reserved: [0; 4],
        }
    }

    /// The samples, predicted and deflated.
    fn coded(&self) -> Vec<u8> {
        // Only what is written to can fail.
        self.deflated().expect("memory takes all that is written")
    }

    fn deflated(&self) -> std::io::Result<Vec<u8>> {
        let side = self.params.resolution as usize;
        let mut encoder = ZlibEncoder::new(Vec::new(), Compression::new(6));
        match &self.samples {
            Samples::Byte(samples) => encoder.write_all(&predicted(samples, side))?,
            Samples::Word(samples) => encoder.write_all(&predicted(samples, side))?,
            Samples::Float(samples) => {
                encoder.write_all(&predicted::<u32>(bytemuck::cast_slice(samples), side))?;
            }
            Samples::Bit(bits) => {
                encoder.write_all(bytemuck::cast_slice(&bits.words))?;
                encoder.write_all(bytemuck::cast_slice(&bits.depths))?;
            }
        }
        encoder.finish()
    }
}

/// Codes of distances: what predictions are made of.
trait Code: Pod + PartialEq {
    const MISS: Self;
    fn plus(self, other: Self) -> Self;
    fn minus(self, other: Self) -> Self;
    /// From those to the left, above, and above that to the left: the plane through them, kept within their range (as in
    /// M. Weinberger et al., "The LOCO-I lossless image compression algorithm", 2000).
    fn predict(left: Self, above: Self, corner: Self) -> Self;
}

macro_rules! code {
    ($($type:ty: $miss:expr,)*) => {$(
        impl Code for $type {
            const MISS: Self = $miss;
            fn plus(self, other: Self) -> Self {
                self.wrapping_add(other)
            }
            fn minus(self, other: Self) -> Self {
                self.wrapping_sub(other)
            }
            fn predict(left: Self, above: Self, corner: Self) -> Self {
                let (least, most) = (left.min(above), left.max(above));
                if corner >= most {
                    least
                } else if corner <= least {
                    most
                } else {
                    left.wrapping_add(above).wrapping_sub(corner)
                }
            }
        }
    )*};
}
code!(u8: Self::MAX, u16: Self::MAX, u32: f32::INFINITY.to_bits(),);

/// The prediction of a hit from those before it in its map; without neighbours that hit it is the last one.
#[inline]
fn prediction<T: Code>(map: &[T], index: usize, side: usize, last: T) -> T {
    let hit = |there: bool, back: usize| {
        let value = there.then(|| map[index - back]);
        value.filter(|value| *value != T::MISS)
    };
    let (inner, below) = (!index.is_multiple_of(side), index >= side);
    let (left, above) = (hit(inner, 1), hit(below, side));
    match (left, above, hit(inner && below, side + 1)) {
        (Some(left), Some(above), Some(corner)) => T::predict(left, above, corner),
        (left, above, _) => left.or(above).unwrap_or(last),
    }
}

/// A bit for each sample, whether it hits; and, byte by byte, how far those that do are off their predictions.
fn predicted<T: Code>(samples: &[T], side: usize) -> Vec<u8> {
    let mut hits = vec![0_u8; samples.len().div_ceil(8)];
    let (mut residuals, mut last) = (Vec::new(), T::zeroed());
    for (map, start) in samples
        .chunks_exact(side * side)
        .zip((0..).step_by(side * side))
    {
        for (index, &value) in map.iter().enumerate().filter(|hit| *hit.1 != T::MISS) {
            hits[(start + index) / 8] |= 1 << ((start + index) % 8);
            residuals.push(value.minus(prediction(map, index, side, last)));
            last = value;
        }
    }
    hits.extend(planes(&residuals));
    hits
}

/// The inverse of [`predicted`]; `None` where there are not as many bytes as that takes.
fn restored<T: Code>(bytes: &[u8], count: usize, side: usize) -> Option<Vec<T>> {
    let (hits, residuals) = bytes.split_at_checked(count.div_ceil(8))?;
    let is_hit = |index: usize| hits[index / 8] >> (index % 8) & 1 == 1;
    if residuals.len() != size_of::<T>() * (0..count).filter(|&index| is_hit(index)).count() {
        return None;
    }
    let mut residuals = from_planes::<T>(residuals).into_iter();
    let (mut samples, mut last) = (vec![T::MISS; count], T::zeroed());
    for (map, start) in samples
        .chunks_exact_mut(side * side)
        .zip((0..).step_by(side * side))
    {
        for index in (0..map.len()).filter(|index| is_hit(start + index)) {
            last = residuals.next()?.plus(prediction(map, index, side, last));
            map[index] = last;
        }
    }
    Some(samples)
}

/// All first bytes, then all second bytes, and so on: bytes of one kind are alike.
fn planes<T: Pod>(values: &[T]) -> Vec<u8> {
    let bytes: &[u8] = bytemuck::cast_slice(values);
    let size = size_of::<T>();
    (0..size)
        .flat_map(|plane| bytes[plane..].iter().step_by(size).copied())
        .collect()
}

/// The inverse of [`planes`].
fn from_planes<T: Pod>(planes: &[u8]) -> Vec<T> {
    let size = size_of::<T>();
    let count = planes.len() / size;
    let mut values = vec![T::zeroed(); count];
    let bytes: &mut [u8] = bytemuck::cast_slice_mut(&mut values);
    for (plane, part) in planes.chunks_exact(count.max(1)).enumerate() {
        for (index, byte) in part.iter().enumerate() {
            bytes[index * size + plane] = *byte;
        }
    }
    values
}

/// The samples of a file whose header is known to be right.
fn decoded(coded: &[u8], params: &FieldParams) -> Result<Samples, &'static str> {
    const LENGTH: &str = "its samples are not as many as its header says";
    let (side, count) = (
        params.resolution as usize,
        params.positions.count() * params.cells(),
    );
    let most = match params.storage {
        Storage::Bit => params.bytes(),
        _ => params.bytes() + count.div_ceil(8) as u64,
    };
    // One byte more than there may be, to find what is too long.
    let mut bytes = Vec::new();
    ZlibDecoder::new(coded)
        .take(most + 1)
        .read_to_end(&mut bytes)
        .map_err(|_| "its samples cannot be decoded")?;
    Ok(match params.storage {
        Storage::Byte => Samples::Byte(restored(&bytes, count, side).ok_or(LENGTH)?),
        Storage::Word => Samples::Word(restored(&bytes, count, side).ok_or(LENGTH)?),
        Storage::Float => {
            let samples: Vec<u32> = restored(&bytes, count, side).ok_or(LENGTH)?;
            let samples: Vec<f32> = samples.into_iter().map(f32::from_bits).collect();
            // A NaN would be taken for a miss; nothing writes one.
            if !samples
                .iter()
                .all(|&value| value >= 0.0 && (value <= 2.0 || value.is_infinite()))
            {
                return Err("a distance is out of its range");
            }
            Samples::Float(samples)
        }
        Storage::Bit if bytes.len() as u64 != most => return Err(LENGTH),
        Storage::Bit => {
            let depths = 4 * params.positions.count();
            let (words, depths) = bytes.split_at(bytes.len() - depths);
            let bits = Bits {
                words: bytemuck::pod_collect_to_vec(words),
                depths: bytemuck::pod_collect_to_vec(depths),
            };
            if !bits.depths.iter().all(|depth| (0.0..=2.0).contains(depth)) {
                return Err("a depth is out of its range");
            }
            Samples::Bit(bits)
        }
    })
}

impl Header {
    fn params(&self, path: &Path, max_bytes: u64) -> Result<FieldParams> {
        let wrong = || damaged(path, "its header holds parameters out of their range");
        let positions = match self.positions {
            [0, rings, 0] => Positions::Slater { rings },
            [1, rows, columns] => Positions::Spherical { rows, columns },
            [2, side, 0] => Positions::Octahedral { side },
            _ => return Err(wrong()),
        };
        let directions = Directions::ALL.get(self.directions as usize);
        let storage = Storage::ALL
            .into_iter()
            .find(|storage| storage.bits() == self.bits);
        let params = FieldParams {
            positions,
            directions: *directions.ok_or_else(wrong)?,
            resolution: self.resolution,
            storage: storage.ok_or_else(wrong)?,
            max_bytes,
        };
        match params.check() {
            Err(Error::TooLarge { bytes, limit }) => Err(Error::TooLarge { bytes, limit }),
            Err(_) => Err(wrong()),
            Ok(()) => Ok(params),
        }
    }
}

fn damaged(path: &Path, reason: &str) -> Error {
    FORMAT.damaged(path, reason).into()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Ten maps of nine samples.
    fn field(storage: Storage) -> Field {
        let params = FieldParams {
            positions: Positions::Slater { rings: 1 },
            resolution: 3,
            storage,
            ..FieldParams::default()
        };
        let mut samples = Samples::with_room(&params);
        let distances: Vec<f32> = (0..90).map(|index| index as f32 / 60.0).collect();
        samples.extend(&distances, &params.cosines());
        let sphere = Sphere {
            center: Vec3::ONE,
            radius: 2.0,
        };
        Field::new(params, sphere, [1, 2], samples)
    }

    /// What is said of a sealed file of a header and samples.
    fn said_of(header: &Header, coded: &[u8]) -> String {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("a.field");
        FORMAT.write(&path, header, &[coded]).expect("a file");
        let error = Field::load(&path, 1 << 20).expect_err("it is wrong");
        error.to_string()
    }

    #[test]
    fn headers_of_whole_files_are_checked() {
        let field = field(Storage::Byte);
        let coded = field.coded();
        let good = field.header(coded.len() as u64);
        let changes: [fn(&mut Header); 13] = [
            |header| header.positions = [3, 1, 0],
            |header| header.positions = [0, 1, 5],
            |header| header.positions = [0, 0, 0],
            |header| header.positions = [0, u32::MAX, 0],
            |header| header.positions = [1, 2, 2],
            |header| header.positions = [2, 513, 0],
            |header| header.directions = 3,
            |header| header.resolution = 0,
            |header| header.resolution = 1025,
            |header| header.bits = 7,
            |header| header.radius = 0.0,
            |header| header.radius = f32::INFINITY,
            |header| header.center[1] = f32::NAN,
        ];
        for (index, change) in changes.into_iter().enumerate() {
            let mut header = good;
            change(&mut header);
            let said = said_of(&header, &coded);
            let reason = match index {
                0..10 => "parameters out of their range",
                _ => "its sphere has no extent",
            };
            assert!(said.contains(reason), "{index}: {said}");
        }
    }

    #[test]
    fn samples_of_whole_files_are_checked() {
        let said_of_samples = |storage, samples: Samples| {
            let mut field = field(storage);
            field.samples = samples;
            let coded = field.coded();
            said_of(&field.header(coded.len() as u64), &coded)
        };
        let bits = |maps: usize, depth: f32| {
            let (words, depths) = (vec![5; maps], vec![depth; maps]);
            Samples::Bit(Bits { words, depths })
        };
        let length = "not as many as its header says";
        for (storage, samples, reason) in [
            (Storage::Byte, Samples::Byte(vec![7; 81]), length),
            (Storage::Byte, Samples::Byte(vec![7; 99]), length),
            (Storage::Word, Samples::Word(vec![7; 81]), length),
            (Storage::Float, Samples::Float(vec![0.5; 99]), length),
            (
                Storage::Float,
                Samples::Float(vec![2.5; 90]),
                "distance is out",
            ),
            (
                Storage::Float,
                Samples::Float(vec![-0.5; 90]),
                "distance is out",
            ),
            (
                Storage::Float,
                Samples::Float(vec![f32::NAN; 90]),
                "distance is out",
            ),
            (Storage::Bit, bits(9, 0.5), length),
            (Storage::Bit, bits(11, 0.5), length),
            (Storage::Bit, bits(10, 2.5), "depth is out"),
            (Storage::Bit, bits(10, f32::NAN), "depth is out"),
        ] {
            let said = said_of_samples(storage, samples.clone());
            assert!(said.contains(reason), "{samples:?}: {said}");
        }
        let header = field(Storage::Byte).header(3);
        assert!(said_of(&header, b"no!").contains("cannot be decoded"));
    }
}
