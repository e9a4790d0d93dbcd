//! What comes from beyond the scene along the maps (Fig. 11): each direction stands for its region of the sphere, so its radiance is
//! the environment's mean over that region. A sun that is smaller than a region is neither lost nor doubled.

use std::f64::consts::{PI, TAU};

use glam::{DVec3, Quat, Vec3};
use isophote_scene::{Environment, EnvironmentMap};

use crate::{Directions, Partition};

/// Pieces of the panorama for each region, on the average at least.
const PIECES: f64 = 64.0;

/// Radiance along each direction of so many maps, turned by a rotation, and along its opposite, W/(sr·m²).
pub(crate) fn radiances(environment: &Environment, maps: u32, rotation: Quat) -> Vec<[Vec3; 2]> {
    match environment {
        Environment::Black => vec![[Vec3::ZERO; 2]; maps as usize],
        Environment::Constant(radiance) => vec![[*radiance; 2]; maps as usize],
        Environment::Map(map) => means(map, maps, rotation),
    }
}

/// The same for the directions of all frames, one after another; empty where nothing shines.
pub(crate) fn of_frames(
    environment: &Environment,
    maps: u32,
    seed: u64,
    frames: u32,
) -> Vec<[Vec3; 2]> {
    if environment.is_black() {
        return Vec::new();
    }
    let of_frame = |frame| radiances(environment, maps, Directions::rotation(seed, frame));
    (0..frames).flat_map(of_frame).collect()
}

/// Texels, cut into pieces where they are large, go to the regions that hold their middles.
fn means(map: &EnvironmentMap, maps: u32, rotation: Quat) -> Vec<[Vec3; 2]> {
    let partition = Partition::new(2 * maps);
    let [width, height] = map.size();
    let texels = f64::from(width) * f64::from(height);
    let cut = (PIECES * f64::from(2 * maps) / texels)
        .sqrt()
        .ceil()
        .max(1.0) as u32;
    let back = rotation.inverse().as_dquat();
    let mut sums = vec![[(DVec3::ZERO, 0.0); 2]; maps as usize];
    for row in 0..height * cut {
        let cosine = |edge: u32| (PI * f64::from(edge) / f64::from(height * cut)).cos();
        let (top, bottom) = (cosine(row), cosine(row + 1));
        let up = 0.5 * (top + bottom);
        let radius = (1.0 - up * up).sqrt();
        for column in 0..width * cut {
            let turn = (f64::from(column) + 0.5) / f64::from(width * cut) - 0.5;
            let (sin, cos) = (TAU * turn).sin_cos();
            let local = back * DVec3::new(radius * sin, up, -radius * cos);
            let region = partition.region_at(local);
            let (region, side) = match region < sums.len() {
                true => (region, 0),
                // At the rim of a region rounding may choose its neighbour.
                false => (partition.region_at(-local).min(sums.len() - 1), 1),
            };
            let texel = (row / cut) * width + column / cut;
            let sum = &mut sums[region][side];
            sum.0 += (top - bottom) * map.texels()[texel as usize].as_dvec3();
            sum.1 += top - bottom;
        }
    }
    let mean = |(sum, weight): (DVec3, f64)| (sum / weight.max(f64::MIN_POSITIVE)).as_vec3();
    sums.iter().map(|sums| sums.map(mean)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A sun of one texel is in the means as a whole, wherever it is and however the directions are turned; so is a gradient.
    #[test]
    fn means_keep_the_power() {
        for (maps, frame) in [(1, 0), (5, 0), (64, 0), (64, 3), (512, 1)] {
            let rotation = Directions::rotation(7, frame);
            for sun in [3, 700, 64 * 31 + 5] {
                let mut texels: Vec<Vec3> = (0..64 * 32)
                    .map(|index| Vec3::splat(0.5 + (index % 64) as f32 / 64.0))
                    .collect();
                texels[sun] = Vec3::splat(3000.0);
                let solid_angle = |row: usize| {
                    let edge = |row: usize| (PI * row as f64 / 32.0).cos();
                    TAU / 64.0 * (edge(row) - edge(row + 1))
                };
                let power = texels.iter().enumerate();
                let power: f64 = power
                    .map(|(index, texel)| f64::from(texel.x) * solid_angle(index / 64))
                    .sum();
                let map = EnvironmentMap::new(64, 32, texels).expect("valid");
                let found = radiances(&Environment::Map(map), maps, rotation);
                let sum: f64 = found.iter().flatten().map(|mean| f64::from(mean.x)).sum();
                let ratio = sum * 4.0 * PI / f64::from(2 * maps) / power;
                assert!((ratio - 1.0).abs() < 0.05, "{maps} {frame} {sun}: {ratio}");
            }
        }
    }

    /// What is bright above is bright along directions that look up.
    #[test]
    fn means_look_where_directions_do() {
        let texels = (0..64 * 32).map(|index| Vec3::splat(f32::from(index < 64 * 16)));
        let map = EnvironmentMap::new(64, 32, texels.collect()).expect("valid");
        for frame in [0, 2] {
            let directions = Directions::new(64).turned(1, frame);
            let rotation = Directions::rotation(1, frame);
            let found = radiances(&Environment::Map(map.clone()), 64, rotation);
            for (direction, [there, back]) in directions.vectors().iter().zip(found) {
                if direction.y.abs() > 0.2 {
                    let [above, below] = if direction.y > 0.0 {
                        [there, back]
                    } else {
                        [back, there]
                    };
                    assert!(
                        above.x > 0.99 && below.x < 0.01,
                        "{direction} {above} {below}"
                    );
                }
            }
        }
    }
}
