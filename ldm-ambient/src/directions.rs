//! The directions of the maps (§3.2): centres of the recursive zonal equal-area partition of the sphere.
//!
//! [`Partition`] is the algorithm of Leopardi (2006) for S²: two polar caps and collars between them. The angle of the
//! caps is that of a region's area; the number of collars makes their angle nearest to the side of a square of that
//! area; the ideal numbers of regions in the collars are rounded, each remainder carried to the next, and the collars'
//! limits are moved so that all regions have the same area.
//!
//! The carried remainders make the regions up to a collar the rounded ideal sum, so for an even number of regions the
//! partition is its own mirror image. How far a collar is turned is free: those of the lower half are turned so that
//! every centre has its antipode among the centres. [`Directions`] keeps one of each two: N maps for 2N regions.

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use glam::{DVec3, Quat, Vec3};
use isophote_scene::sample::Sampler;

/// A partition of the unit sphere into regions of equal area and small diameter.
#[derive(Clone, Debug, PartialEq)]
pub struct Partition {
    zones: Vec<Zone>,
}

/// A cap or a collar: what lies between two colatitudes, cut into regions of equal longitudes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Zone {
    /// From the pole +Y, radians.
    pub colatitudes: [f64; 2],
    /// How many regions it has.
    pub regions: u32,
    /// Where its first region begins, radians.
    pub longitude: f64,
}

/// What lies between two colatitudes and two longitudes; a cap where those are the whole circle and a pole belongs to it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Region {
    /// From the pole +Y, radians.
    pub colatitudes: [f64; 2],
    /// Around it, radians, from +Z towards +X.
    pub longitudes: [f64; 2],
}

impl Partition {
    /// Cuts the sphere into a number of regions, at least 1.
    pub fn new(regions: u32) -> Self {
        let limits = match regions {
            0 | 1 => return Self::whole(),
            _ => limits(regions),
        };
        let count = limits.len() - 1;
        let mut zones: Vec<Zone> = limits
            .windows(2)
            .map(|ends| Zone {
                colatitudes: [ends[0], ends[1]].map(|cumulative| colatitude(cumulative, regions)),
                regions: (ends[1] - ends[0]) as u32,
                longitude: 0.0,
            })
            .collect();
        let mut turned = 0.0;
        for zone in 2..count - 1 {
            let (above, here) = (zones[zone - 1].regions, zones[zone].regions);
            turned += twist(above, here);
            zones[zone].longitude = turned.fract() * TAU;
        }
        for zone in 0..count / 2 {
            zones[count - 1 - zone].longitude = (zones[zone].longitude + PI) % TAU;
        }
        Self { zones }
    }

    fn whole() -> Self {
        let zone = Zone {
            colatitudes: [0.0, PI],
            regions: 1,
            longitude: 0.0,
        };
        Self { zones: vec![zone] }
    }

    /// The caps and collars from the pole +Y to its opposite.
    pub fn zones(&self) -> &[Zone] {
        &self.zones
    }

    /// The number of the region that holds a unit vector.
    pub fn region_at(&self, direction: DVec3) -> usize {
        let colatitude = direction.y.clamp(-1.0, 1.0).acos();
        let longitude = direction.x.atan2(direction.z);
        let above = |zone: &Zone| zone.colatitudes[1] <= colatitude;
        let zones = self.zones.partition_point(above).min(self.zones.len() - 1);
        let (before, zone) = (&self.zones[..zones], &self.zones[zones]);
        let turn = ((longitude - zone.longitude) / TAU).rem_euclid(1.0);
        let number = (turn * f64::from(zone.regions)) as u32;
        let first: u32 = before.iter().map(|zone| zone.regions).sum();
        (first + number.min(zone.regions - 1)) as usize
    }

    /// All regions, zone by zone.
    pub fn regions(&self) -> impl Iterator<Item = Region> + '_ {
        self.zones.iter().flat_map(|zone| {
            let width = TAU / f64::from(zone.regions);
            (0..zone.regions).map(move |index| {
                let start = zone.longitude + f64::from(index) * width;
                Region {
                    colatitudes: zone.colatitudes,
                    longitudes: [start, start + width],
                }
            })
        })
    }
}

/// How many regions there are up to the end of each zone, beginning with 0.
fn limits(regions: u32) -> Vec<f64> {
    let total = f64::from(regions);
    let polar = colatitude(1.0, regions);
    let ideal_angle = (4.0 * PI / total).sqrt();
    let collars = match regions {
        2 => 0.0,
        _ => ((PI - 2.0 * polar) / ideal_angle).round().max(1.0),
    };
    let angle = (PI - 2.0 * polar) / collars;
    let mut limits = vec![0.0, 1.0];
    // The remainder of the regions that are ideal so far and those that there are.
    let (mut remainder, mut ideal_before) = (0.0, 1.0);
    for collar in 1..=collars as u32 {
        let ideal = total * (0.5 * (polar + f64::from(collar) * angle)).sin().powi(2);
        let wanted = ideal - ideal_before;
        let rounded = (wanted + remainder).round();
        remainder += wanted - rounded;
        ideal_before = ideal;
        limits.push(limits[limits.len() - 1] + rounded);
    }
    limits.push(total);
    limits
}

/// The angle of a cap that has the area of some of the regions.
fn colatitude(of: f64, regions: u32) -> f64 {
    2.0 * (of / f64::from(regions)).sqrt().min(1.0).asin()
}

/// By which part of a turn a collar is turned against the one above, so that centres are far from each other: half the
/// difference of their sectors, and what is best for circles of so many points (Leopardi's `circle_offset`).
fn twist(above: u32, here: u32) -> f64 {
    let (a, b) = (f64::from(above), f64::from(here));
    0.5 * (1.0 / b - 1.0 / a) + 0.5 * f64::from(common_divisor(above, here)) / (a * b)
}

fn common_divisor(a: u32, b: u32) -> u32 {
    if b == 0 { a } else { common_divisor(b, a % b) }
}

impl Region {
    /// Steradians.
    pub fn area(&self) -> f64 {
        let [top, bottom] = self.colatitudes;
        (self.longitudes[1] - self.longitudes[0]) * (top.cos() - bottom.cos())
    }

    /// Whether a pole belongs to it.
    pub fn is_cap(&self) -> bool {
        self.colatitudes[0] == 0.0 || self.colatitudes[1] == PI
    }

    /// The unit vector in its middle: the pole of a cap.
    pub fn center(&self) -> DVec3 {
        let [top, bottom] = self.colatitudes;
        if top == 0.0 {
            return DVec3::Y;
        }
        if bottom == PI {
            return DVec3::NEG_Y;
        }
        point(
            0.5 * (top + bottom),
            0.5 * (self.longitudes[0] + self.longitudes[1]),
        )
    }

    /// The greatest distance of two of its points, or a little more: the chord of its colatitudes and that of its widest
    /// parallel as sides of a right angle (Leopardi's bound for a region).
    pub fn diameter_bound(&self) -> f64 {
        let [top, bottom] = self.colatitudes;
        let chord = |angle: f64| 2.0 * (0.5 * angle).sin();
        if self.is_cap() {
            let angle = if top == 0.0 { bottom } else { PI - top };
            return if angle >= FRAC_PI_2 {
                2.0
            } else {
                2.0 * angle.sin()
            };
        }
        let widest = FRAC_PI_2.clamp(top, bottom).sin();
        let across = (self.longitudes[1] - self.longitudes[0]).min(PI);
        chord(bottom - top).hypot(widest * chord(across)).min(2.0)
    }
}

fn point(colatitude: f64, longitude: f64) -> DVec3 {
    let (sin, cos) = colatitude.sin_cos();
    DVec3::new(sin * longitude.sin(), cos, sin * longitude.cos())
}

/// The directions of N maps: with their opposites the centres of 2N regions.
#[derive(Clone, Debug, PartialEq)]
pub struct Directions {
    vectors: Vec<Vec3>,
}

impl Directions {
    /// The directions of a number of maps, at least 1.
    pub fn new(maps: u32) -> Self {
        let partition = Partition::new(2 * maps.max(1));
        let middle = partition.zones.len() / 2;
        let zones = partition.zones.iter().enumerate();
        let kept = zones.map(|(index, zone)| {
            // Of a collar across the equator the second half are the antipodes of the first (Fig. 5).
            let across = partition.zones.len() % 2 == 1 && index == middle;
            match (index < middle, across) {
                (true, _) => zone.regions,
                (false, true) => zone.regions / 2,
                (false, false) => 0,
            }
        });
        let kept: u32 = kept.sum();
        let vectors = partition
            .regions()
            .take(kept as usize)
            .map(|region| region.center().as_vec3().normalize())
            .collect();
        Self { vectors }
    }

    /// Unit vectors; each stands for itself and its opposite.
    pub fn vectors(&self) -> &[Vec3] {
        &self.vectors
    }

    /// The same, all turned by one random rotation of a frame; frame 0 is not turned (§6, progressive rendering).
    #[must_use]
    pub fn turned(&self, seed: u64, frame: u32) -> Self {
        if frame == 0 {
            return self.clone();
        }
        let rotation = Self::rotation(seed, frame);
        let turn = |vector: &Vec3| (rotation * *vector).normalize();
        Self {
            vectors: self.vectors.iter().map(turn).collect(),
        }
    }

    /// By what [`turned`](Self::turned) turns them: a rotation of uniform density (Shoemake 1992), stratified over the frames.
    pub(crate) fn rotation(seed: u64, frame: u32) -> Quat {
        if frame == 0 {
            return Quat::IDENTITY;
        }
        let sampler = Sampler::new(seed, 0x1d4a_11b5, frame);
        let (u, v) = (sampler.get_2d(0), sampler.get_1d(1));
        let (a, b) = ((1.0 - u.x).sqrt(), u.x.sqrt());
        let [y, z] = [u.y, v].map(|turn| std::f32::consts::TAU * turn);
        Quat::from_xyzw(a * y.sin(), a * y.cos(), b * z.sin(), b * z.cos()).normalize()
    }

    /// Some of them, at most so many, as evenly spread as they can be: the nearest to the directions of so many maps.
    pub fn subset(&self, count: u32) -> Vec<Vec3> {
        let count = count.min(self.vectors.len() as u32);
        let coarse = Self::new(count);
        let nearest = coarse.vectors().iter().map(|vector| self.nearest(*vector));
        let mut chosen: Vec<usize> = nearest.collect();
        chosen.sort_unstable();
        chosen.dedup();
        chosen.iter().map(|&index| self.vectors[index]).collect()
    }

    /// The greatest angle between any direction and the nearest line of these, radians, or a little more: that from the
    /// centre of a region to its corners.
    pub fn largest_angle(&self) -> f32 {
        let regions = Partition::new(2 * self.vectors.len() as u32);
        let reach = |region: Region| {
            let [top, bottom] = region.colatitudes;
            if region.is_cap() {
                return if top == 0.0 { bottom } else { PI - top };
            }
            let corner = |colatitude| point(colatitude, region.longitudes[0]);
            let angle = |colatitude| corner(colatitude).angle_between(region.center());
            angle(top).max(angle(bottom))
        };
        regions.regions().map(reach).fold(0.0, f64::max) as f32
    }

    /// The index of the direction whose line is nearest to that of a vector.
    pub fn nearest(&self, direction: Vec3) -> usize {
        let mut best = (0, f32::NEG_INFINITY);
        for (index, vector) in self.vectors.iter().enumerate() {
            let cosine = vector.dot(direction).abs();
            if cosine > best.1 {
                best = (index, cosine);
            }
        }
        best.0
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::FRAC_PI_3;

    use super::*;

    const COUNTS: [u32; 14] = [
        2, 3, 4, 5, 6, 10, 33, 64, 128, 256, 1000, 1024, 4096, 10_000,
    ];

    /// What Leopardi's toolbox prints for `eq_caps(2, 10)`, and for 4 regions.
    #[test]
    fn zones_are_as_published() {
        let ten = Partition::new(10);
        let counts: Vec<u32> = ten.zones().iter().map(|zone| zone.regions).collect();
        assert_eq!(counts, [1, 4, 4, 1]);
        let ends = ten.zones().iter().map(|zone| zone.colatitudes[1]);
        for (end, published) in ends.zip([0.6435, FRAC_PI_2, 2.4981, PI]) {
            assert!((end - published).abs() < 5e-5, "{end}");
        }
        let four = Partition::new(4);
        let counts: Vec<u32> = four.zones().iter().map(|zone| zone.regions).collect();
        assert_eq!(counts, [1, 2, 1]);
        assert!((four.zones()[0].colatitudes[1] - FRAC_PI_3).abs() < 5e-5);
        // `eq_diam_bound(2, 10)`.
        let bounds = ten.regions().map(|region| region.diameter_bound());
        let largest = bounds.fold(0.0, f64::max);
        assert!((largest - 1.6733).abs() < 5e-5, "{largest}");
    }

    #[test]
    fn regions_have_equal_areas_and_cover_the_sphere() {
        for count in COUNTS {
            let regions: Vec<Region> = Partition::new(count).regions().collect();
            assert_eq!(regions.len(), count as usize);
            let area = 4.0 * PI / f64::from(count);
            for region in &regions {
                assert!((region.area() - area).abs() < 1e-10, "{count}: {region:?}");
            }
            let partition = Partition::new(count);
            for (index, region) in regions.iter().enumerate() {
                assert_eq!(partition.region_at(region.center()), index, "{count}");
            }
        }
    }

    /// No two points of a region are farther from each other than its bound, and that is within 7/√N.
    #[test]
    fn diameters_are_bounded() {
        for count in COUNTS {
            for region in Partition::new(count).regions() {
                let bound = region.diameter_bound();
                assert!(bound * f64::from(count).sqrt() <= 7.0, "{count}: {bound}");
                let steps = |[low, high]: [f64; 2]| {
                    (0..=8).map(move |i| low + (high - low) * f64::from(i) / 8.0)
                };
                let points: Vec<DVec3> = steps(region.colatitudes)
                    .flat_map(|theta| steps(region.longitudes).map(move |phi| point(theta, phi)))
                    .collect();
                if count > 300 && region.colatitudes[0] > 1.0 && region.longitudes[0] > 0.5 {
                    continue;
                }
                for a in &points {
                    for b in &points {
                        assert!(a.distance(*b) <= bound + 1e-12, "{count}: {region:?}");
                    }
                }
            }
        }
    }

    /// The maps' directions and their opposites are the centres of all regions, each once.
    #[test]
    fn one_of_each_antipodal_pair_is_kept() {
        for maps in [1, 2, 3, 5, 16, 64, 100, 128, 512] {
            let directions = Directions::new(maps);
            assert_eq!(directions.vectors().len(), maps as usize);
            let centers: Vec<Vec3> = Partition::new(2 * maps)
                .regions()
                .map(|region| region.center().as_vec3())
                .collect();
            let near = |vector: Vec3| {
                centers
                    .iter()
                    .filter(|center| center.distance(vector) < 1e-5)
                    .count()
            };
            for (index, &vector) in directions.vectors().iter().enumerate() {
                assert_eq!([near(vector), near(-vector)], [1, 1], "{maps}: {vector}");
                for other in &directions.vectors()[..index] {
                    assert!(vector.dot(*other).abs() < 1.0 - 1e-5, "{maps}");
                }
                assert_eq!(directions.nearest(-2.0 * vector), index);
            }
        }
    }

    /// No direction is farther from the nearest than is said, and some are nearly as far.
    #[test]
    fn nearest_directions_are_near() {
        for maps in [1, 2, 5, 16, 100, 512] {
            let directions = Directions::new(maps);
            let bound = directions.largest_angle();
            let angle = |index| {
                let [u, v] = Sampler::new(2, 0, index).get_2d(0).to_array();
                let vector = point((2.0 * f64::from(u) - 1.0).acos(), f64::from(v) * 2.0 * PI);
                let vector = vector.as_vec3();
                let nearest = directions.vectors()[directions.nearest(vector)];
                nearest.dot(vector).abs().min(1.0).acos()
            };
            let farthest = (0..20_000).map(angle).fold(0.0, f32::max);
            assert!(farthest <= bound + 1e-3, "{maps}: {farthest} of {bound}");
            assert!(farthest > 0.7 * bound, "{maps}: {farthest} of {bound}");
        }
    }

    #[test]
    fn rotations_keep_angles_and_differ() {
        let directions = Directions::new(32);
        assert_eq!(directions.turned(3, 0), directions);
        let (first, second) = (directions.turned(3, 1), directions.turned(3, 2));
        assert!(first.vectors()[0].distance(second.vectors()[0]) > 1e-3);
        for (a, b) in [(0, 5), (7, 30)] {
            let before = directions.vectors()[a].dot(directions.vectors()[b]);
            let after = first.vectors()[a].dot(first.vectors()[b]);
            assert!((before - after).abs() < 1e-6);
        }
    }
}
