//! Maps in files, so that they are built once.
//!
//! ```text
//! header    112 bytes: the parameters, how many of everything there are, of which scene
//! arrays    frames, pixels, layers, blocks, surfaces, planes
//! ```
//!
//! in a [`Sealed`] file. The scene is known by the hash of the selected triangles, what they are and whether they may let
//! rays pass, and of the bounds. Every number in it that points at something has been checked before a ray is traced.

use std::{hash::Hasher, path::Path, sync::Arc};

use bytemuck::{Pod, Zeroable};
use glam::Affine3A;
use isophote_scene::{
    Scene, Selection,
    sealed::{Sealed, take},
    world_triangles,
};
use siphasher::sip128::{Hasher128, SipHasher13};

use super::{
    maps::{Block, BlockSurfaces, Frame, LANES, Layers, Maps, PADDING, Packing, Pixel, TILE},
    trace::LdiTracer,
};
use crate::{Coverage, Directions, LdiParams, Result};

const FORMAT: Sealed = Sealed {
    magic: *b"ISOPHLDI",
    // 1 had depths of 8 or 16 bits.
    version: 2,
    what: "layered depth images",
    remedy: "build the maps anew",
};

#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
struct Header {
    cells: u32,
    resolution: u32,
    coverage: u32,
    epsilon: f32,
    /// How layers are packed.
    layer_bytes: u32,
    depth_bits: u32,
    layers: u64,
    blocks: u64,
    scene: [u64; 2],
    depth_error: f32,
    unused: u32,
    reserved: [u64; 6],
}

impl LdiTracer {
    /// Writes the maps into a file, whole or not at all.
    ///
    /// # Errors
    /// [`Error::Scene`](crate::Error::Scene) when the file cannot be written.
    pub fn save(&self, path: &Path) -> Result<()> {
        let header = self.header();
        let maps = self.maps();
        let arrays: [&[u8]; 6] = [
            bytemuck::cast_slice(&maps.frames),
            bytemuck::cast_slice(&maps.pixels),
            maps.layers.bytes(),
            bytemuck::cast_slice(&maps.blocks),
            bytemuck::cast_slice(&maps.surfaces),
            bytemuck::cast_slice(&maps.planes),
        ];
        FORMAT.write(path, &header, &arrays)?;
        Ok(())
    }

    /// Reads maps that were [saved](Self::save) of the same selection of the same scene.
    ///
    /// # Errors
    /// [`Error::Scene`](crate::Error::Scene) with what [`Sealed::read`] returns, and with [`Foreign`](isophote_scene::Error::Foreign) when it is
    /// of another scene or selection.
    pub fn load(path: &Path, scene: &Arc<Scene>, selection: &Selection) -> Result<Self> {
        let (header, bytes) = FORMAT.read(path, |header: &Header| header.length(path))?;
        if header.scene != scene_key(scene, &scene.transforms(), selection) {
            let reason = "the maps are of another scene, or of another selection of it";
            return Err(FORMAT.foreign(path, reason).into());
        }
        let params = header.params(path)?;
        let maps = header.maps(path, &bytes)?;
        check(&maps, &params, scene).map_err(|reason| FORMAT.damaged(path, reason))?;
        Ok(Self::from_maps(scene, selection, &params, maps))
    }

    fn header(&self) -> Header {
        let (maps, params) = (self.maps(), self.params());
        Header {
            cells: params.cells,
            resolution: params.resolution,
            coverage: params.coverage as u32,
            epsilon: params.epsilon,
            layer_bytes: maps.layers.packing().bytes(),
            depth_bits: maps.layers.packing().depth_bits(),
            layers: maps.layers.count() as u64,
            blocks: maps.blocks.len() as u64,
            scene: self.scene_key(),
            depth_error: params.depth_error,
            unused: 0,
            reserved: [0; 6],
        }
    }
}

/// The hash of what the maps are built of.
pub(crate) fn scene_key(scene: &Scene, transforms: &[Affine3A], selection: &Selection) -> [u64; 2] {
    let mut hasher = SipHasher13::new();
    for triangle in world_triangles(scene, transforms, selection) {
        let surface = triangle.surface;
        let masked = scene.is_masked(surface);
        hasher.write(bytemuck::cast_slice(&triangle.corners));
        hasher.write(bytemuck::cast_slice(&[
            surface.instance,
            surface.primitive,
            u32::from(masked),
        ]));
    }
    if let Some(bounds) = selection.bounds {
        hasher.write(bytemuck::cast_slice(&[bounds.min, bounds.max]));
    }
    let hash = hasher.finish128();
    [hash.h1, hash.h2]
}

impl Header {
    fn params(&self, path: &Path) -> isophote_scene::Result<LdiParams> {
        let params = LdiParams {
            cells: self.cells,
            resolution: self.resolution,
            coverage: match self.coverage {
                0 => Coverage::Center,
                1 => Coverage::Touched,
                _ => {
                    return Err(FORMAT.damaged(path, "its header names no known kind of layers"));
                }
            },
            epsilon: self.epsilon,
            depth_error: self.depth_error,
            // What is in a file may be as large as it is.
            max_bytes: u64::MAX,
        };
        if params.check().is_err() || self.packing().is_none() {
            let reason = "its header holds parameters out of their range";
            return Err(FORMAT.damaged(path, reason));
        }
        // Maps that are built anew are held to the usual limit.
        Ok(LdiParams {
            max_bytes: LdiParams::default().max_bytes.max(16 * params.pixels()),
            ..params
        })
    }

    fn packing(&self) -> Option<Packing> {
        Packing::from_parts(self.depth_bits, self.layer_bytes)
    }

    /// Frames, pixels, bytes of layers, blocks, surfaces and planes.
    fn counts(&self) -> Option<[u64; 6]> {
        let frames = Directions::new(self.cells).maps() as u64;
        let side = u64::from(self.resolution.next_multiple_of(TILE));
        let planes = match self.coverage {
            0 => self.blocks.checked_mul(LANES as u64)?,
            _ => 0,
        };
        let layers = self.layers.checked_mul(self.layer_bytes.into())?;
        Some([
            frames,
            frames * side * side + 1,
            layers.checked_add(PADDING as u64)?,
            self.blocks,
            self.blocks,
            planes,
        ])
    }

    /// Bytes of the arrays.
    fn length(&self, path: &Path) -> isophote_scene::Result<u64> {
        self.params(path)?;
        let sizes = [
            size_of::<Frame>() as u64,
            size_of::<Pixel>() as u64,
            1,
            size_of::<Block>() as u64,
            size_of::<BlockSurfaces>() as u64,
            size_of::<[f32; 4]>() as u64,
        ];
        let length = || {
            let counts = self.counts()?.into_iter().zip(sizes);
            counts.into_iter().try_fold(0_u64, |length, (count, size)| {
                length.checked_add(count.checked_mul(size)?)
            })
        };
        length().ok_or_else(|| FORMAT.damaged(path, "its header counts too much"))
    }

    fn maps(&self, path: &Path, bytes: &[u8]) -> Result<Maps> {
        let (counts, packing) = self
            .counts()
            .zip(self.packing())
            .ok_or_else(|| FORMAT.damaged(path, "its header counts too much"))?;
        let mut rest = bytes;
        let counts = counts.map(|count| count as usize);
        Ok(Maps {
            resolution: self.resolution.next_multiple_of(TILE),
            frames: take(&mut rest, counts[0]),
            pixels: take(&mut rest, counts[1]),
            layers: Layers::from_bytes(packing, take(&mut rest, counts[2])),
            blocks: take(&mut rest, counts[3]),
            surfaces: take(&mut rest, counts[4]),
            planes: take(&mut rest, counts[5]),
        })
    }
}

/// Whether everything points at something that is there.
fn check(maps: &Maps, params: &LdiParams, scene: &Scene) -> Result<(), &'static str> {
    let ordered = maps
        .pixels
        .windows(2)
        .all(|two| two[0].first <= two[1].first);
    let ends = maps.pixels.first().zip(maps.pixels.last());
    let count = maps.layers.count();
    if !ordered || ends.is_none_or(|(a, b)| a.first != 0 || b.first as usize != count) {
        return Err("its pixels do not share out its layers");
    }
    let targets = match params.coverage {
        Coverage::Center => maps.blocks.len() * LANES,
        Coverage::Touched => maps.blocks.len(),
    };
    if maps
        .layers
        .iter()
        .any(|layer| layer.target as usize >= targets)
    {
        return Err("a layer is of no triangle");
    }
    let exists = |instance: u32, primitive: u32| {
        scene
            .instances
            .get(instance as usize)
            .is_some_and(|placed| (primitive as usize) < scene.mesh(placed).triangles.len())
    };
    // A lane is empty, or a triangle of the scene.
    let known = maps
        .blocks
        .iter()
        .zip(&maps.surfaces)
        .all(|(block, surfaces)| {
            (0..LANES).all(|lane| {
                let surface = surfaces.surface(lane);
                exists(surface.instance, surface.primitive)
                    || surface.instance == u32::MAX && block.corners(lane)[0].x.is_nan()
            })
        });
    if !known {
        return Err("a triangle is none of the scene's");
    }
    let scales = maps.frames.iter().flat_map(|frame| frame.scale);
    if !scales
        .into_iter()
        .all(|scale| scale.is_finite() && scale > 0.0)
    {
        return Err("a map has no extent");
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use isophote_scene::{BuildTracer, builtin};

    use super::*;

    /// A checksum only tells that a file is as it was written: one that was written wrong is refused too.
    #[test]
    fn what_points_nowhere_is_found() {
        let scene = Arc::new(builtin::build("cornell").unwrap());
        for coverage in [Coverage::Touched, Coverage::Center] {
            let params = LdiParams {
                cells: 1,
                resolution: 16,
                coverage,
                ..LdiParams::default()
            };
            let built = LdiTracer::build(&scene, &Selection::default(), &params).unwrap();
            let reason = |spoil: &dyn Fn(&mut Maps)| {
                let mut maps = built.maps().clone();
                spoil(&mut maps);
                check(&maps, &params, &scene)
            };
            assert_eq!(reason(&|_| {}), Ok(()));
            let share = Err("its pixels do not share out its layers");
            assert_eq!(reason(&|maps| maps.pixels[1].first = u32::MAX), share);
            assert_eq!(reason(&|maps| maps.pixels[0].first = 1), share);
            let last = built.maps().pixels.len() - 1;
            assert_eq!(reason(&|maps| maps.pixels[last].first += 1), share);
            assert_eq!(reason(&|maps| maps.pixels.clear()), share);
            let fewer = |maps: &mut Maps| maps.blocks.truncate(1);
            assert_eq!(reason(&fewer), Err("a layer is of no triangle"));
            let other = Err("a triangle is none of the scene's");
            assert_eq!(
                reason(&|maps| maps.surfaces[0].primitives[0] = 1 << 30),
                other
            );
            assert_eq!(
                reason(&|maps| maps.surfaces[0].instances[0] = u32::MAX),
                other
            );
            for scale in [0.0, -1.0, f32::NAN, f32::INFINITY] {
                let spoilt = reason(&|maps| maps.frames[1].scale[2] = scale);
                assert_eq!(spoilt, Err("a map has no extent"));
            }
        }
    }
}
