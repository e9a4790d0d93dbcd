//! Parts of a bake: what a shard computed, in a file that says of what and how.
//!
//! The file is sealed ([`isophote_scene::sealed`]): the length of a JSON text, that text, and the values as floats. Parts are only merged when everything that decides the values is the same, so that the merged bake is bit for bit
//! the one that was made in one piece.

use std::{
    collections::BTreeMap,
    hash::Hasher,
    path::{Path, PathBuf},
};

use anyhow::{Result, bail, ensure};
use bytemuck::{Pod, Zeroable};
use glam::Vec3;
use isophote_scene::{GltfSource, Receiver, Scene, sealed::Sealed};
use serde::{Deserialize, Serialize};
use siphasher::sip::SipHasher13;

const FILE: Sealed = Sealed {
    magic: *b"isoBAKED",
    version: 1,
    what: "a part of a bake",
    remedy: "compute that part again",
};

/// How long the JSON is, and how long the values after it, in bytes.
#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct Lengths {
    json: u64,
    values: u64,
}

/// Which of how many parts, from 1.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(super) struct Shard {
    pub(super) number: u32,
    pub(super) of: u32,
}

/// What must be the same for parts to go together.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Fingerprint {
    /// Of the program.
    pub(super) version: String,
    pub(super) commit: Option<String>,
    /// Everything that was traced, and the points that light was computed for.
    pub(super) scene: u64,
    /// How many points those are, and how many make a piece.
    pub(super) receivers: usize,
    pub(super) piece: usize,
    /// By their names on the command line.
    pub(super) settings: BTreeMap<String, String>,
}

/// The JSON of a file.
#[derive(Serialize, Deserialize)]
struct Header {
    shard: Shard,
    #[serde(flatten)]
    fingerprint: Fingerprint,
    /// One for occlusion, three for light.
    channels: usize,
}

impl Shard {
    /// Parses `i/n`.
    pub(super) fn parse(text: &str) -> Result<Self, String> {
        let parts = text.split_once('/');
        let parts = parts.and_then(|(number, of)| Some((number.parse().ok()?, of.parse().ok()?)));
        parts
            .map(|(number, of)| Self { number, of })
            .filter(|shard| (1..=shard.of).contains(&shard.number) && shard.of <= 1 << 16)
            .ok_or_else(|| "expected I/N with I from 1 to N, such as 3/8".into())
    }

    /// Its pieces of so many.
    pub(super) fn pieces(self, count: usize) -> Vec<usize> {
        (self.number as usize - 1..count)
            .step_by(self.of as usize)
            .collect()
    }
}

impl Fingerprint {
    /// How many pieces the receivers make.
    pub(super) fn pieces(&self) -> usize {
        self.receivers.div_ceil(self.piece)
    }

    /// How many receivers a piece has.
    fn len(&self, piece: usize) -> usize {
        self.receivers.min((piece + 1) * self.piece) - piece * self.piece
    }
}

/// A number that differs when anything does that is traced or lit.
pub(super) fn fingerprint(source: &GltfSource, scene: &Scene, receivers: &[Receiver]) -> u64 {
    let mut hasher = SipHasher13::new();
    hasher.write(&source.json);
    for bytes in source.buffers.iter().chain(&source.images).flatten() {
        hasher.write(bytes);
    }
    let mut floats = |values: [f32; 3]| {
        for value in values {
            hasher.write_u32(value.to_bits());
        }
    };
    for instance in &scene.instances {
        let columns = instance.transform.to_cols_array();
        columns.chunks(3).for_each(|c| floats([c[0], c[1], c[2]]));
        let mesh = scene.mesh(instance);
        for corner in mesh.triangles.as_flattened() {
            floats(mesh.positions[*corner as usize].to_array());
        }
    }
    for receiver in receivers {
        let point = &receiver.point;
        floats(point.position.to_array());
        floats(point.shading_normal.to_array());
        floats(point.geometric_normal.to_array());
    }
    hasher.finish()
}

/// Writes a part.
pub(super) fn save(
    path: &Path,
    shard: Shard,
    fingerprint: &Fingerprint,
    values: &[Vec3],
    channels: usize,
) -> Result<()> {
    let header = Header {
        shard,
        fingerprint: fingerprint.clone(),
        channels,
    };
    let json = serde_json::to_vec(&header)?;
    let floats = values
        .iter()
        .flat_map(|value| value.to_array().into_iter().take(channels));
    let floats: Vec<f32> = floats.collect();
    let floats: &[u8] = bytemuck::cast_slice(&floats);
    let lengths = Lengths {
        json: json.len() as u64,
        values: floats.len() as u64,
    };
    FILE.write(path, &lengths, &[&json, floats])?;
    Ok(())
}

/// A part that was read.
struct Part {
    header: Header,
    values: Vec<Vec3>,
}

/// The settings that a part was made with.
pub(crate) fn settings(path: &Path) -> Result<BTreeMap<String, String>> {
    Ok(load(path)?.header.fingerprint.settings)
}

fn load(path: &Path) -> Result<Part> {
    let (lengths, bytes) = FILE.read(path, |lengths: &Lengths| {
        let sum = lengths.json.checked_add(lengths.values);
        sum.ok_or_else(|| FILE.damaged(path, "its lengths are impossible"))
    })?;
    let (json, values) = bytes.split_at(lengths.json as usize);
    let header: Header = serde_json::from_slice(json)
        .map_err(|error| FILE.damaged(path, &format!("what it was made of: {error}")))?;
    let floats: Vec<f32> = bytemuck::pod_collect_to_vec(values);
    let values: Vec<Vec3> = match header.channels {
        1 => floats.into_iter().map(Vec3::splat).collect(),
        3 => floats.chunks_exact(3).map(Vec3::from_slice).collect(),
        channels => bail!(FILE.damaged(path, &format!("it has {channels} channels"))),
    };
    Ok(Part { header, values })
}

/// Puts parts together: the values of all receivers in order.
pub(super) fn merge(paths: &[PathBuf], expected: &Fingerprint) -> Result<Vec<Vec3>> {
    let mut found: BTreeMap<u32, (PathBuf, Part)> = BTreeMap::new();
    for path in paths {
        let part = load(path)?;
        check(path, &part.header.fingerprint, expected)?;
        let shard = part.header.shard;
        if let Some((other, first)) = found.values().next() {
            ensure!(
                shard.of == first.header.shard.of,
                "{}: is one of {} parts, but {} is one of {}",
                path.display(),
                shard.of,
                other.display(),
                first.header.shard.of
            );
        }
        if let Some((other, _)) = found.insert(shard.number, (path.clone(), part)) {
            bail!(
                "{} and {} are both part {} of {}",
                other.display(),
                path.display(),
                shard.number,
                shard.of
            );
        }
    }
    let of = found
        .values()
        .next()
        .map_or(0, |(_, part)| part.header.shard.of);
    let missing: Vec<String> = (1..=of)
        .filter(|number| !found.contains_key(number))
        .map(|number| number.to_string())
        .collect();
    ensure!(
        missing.is_empty(),
        "--merge: of {of} parts these are missing: {}",
        missing.join(", ")
    );
    let mut values = vec![Vec3::ZERO; expected.receivers];
    for (path, part) in found.values() {
        let pieces = part.header.shard.pieces(expected.pieces());
        let count: usize = pieces.iter().map(|&piece| expected.len(piece)).sum();
        ensure!(
            count == part.values.len(),
            "{}: has {} values, but its pieces have {count}",
            path.display(),
            part.values.len()
        );
        let mut rest = &part.values[..];
        for piece in pieces {
            let (own, after) = rest.split_at(expected.len(piece));
            values[piece * expected.piece..][..own.len()].copy_from_slice(own);
            rest = after;
        }
    }
    Ok(values)
}

/// Refuses a part that was made of something else, or in another way.
fn check(path: &Path, found: &Fingerprint, expected: &Fingerprint) -> Result<()> {
    let name = path.display();
    ensure!(
        (&found.version, &found.commit) == (&expected.version, &expected.commit),
        "{name}: was made by isophote {} ({}), this is {} ({})",
        found.version,
        found.commit.as_deref().unwrap_or("unknown"),
        expected.version,
        expected.commit.as_deref().unwrap_or("unknown")
    );
    for (setting, value) in &expected.settings {
        let other = found.settings.get(setting);
        ensure!(
            other == Some(value),
            "{name}: was made with --{setting} {}, not {value}",
            other.map_or("unset", String::as_str)
        );
    }
    ensure!(
        found.settings.len() == expected.settings.len(),
        "{name}: was made with other settings"
    );
    ensure!(
        (found.scene, found.receivers, found.piece)
            == (expected.scene, expected.receivers, expected.piece),
        "{name}: was made of another scene"
    );
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shards_share_all_pieces() {
        for (count, of) in [(0, 1), (1, 3), (7, 3), (8, 4)] {
            let mut all: Vec<usize> = (1..=of)
                .flat_map(|number| Shard { number, of }.pieces(count))
                .collect();
            all.sort_unstable();
            assert_eq!(all, (0..count).collect::<Vec<_>>());
        }
        for wrong in ["", "1", "0/2", "3/2", "a/b", "1/0", "1/99999999"] {
            assert!(Shard::parse(wrong).is_err(), "{wrong}");
        }
    }
}
