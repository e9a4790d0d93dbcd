//! How far away the closest surface is: the other query that §1 mentions, for collision detection.

use glam::Vec3;
use isophote_scene::sample::Frame;

use super::field::Field;

impl Field {
    /// The distance from a point to the closest sample that is seen from the positions next to it, in the field's space,
    /// where the sphere is the unit sphere; `None` where they see none. Constant time: three maps are read, and six more,
    /// along the axes, for points within the sphere, which may be surrounded by the object.
    ///
    /// Too far by about half the distance between samples, or where none of the positions sees the closest surface.
    pub fn closest(&self, point: Vec3) -> Option<f32> {
        let outward = point.try_normalize().unwrap_or(Vec3::Z);
        let params = &self.params;
        let mut best = f32::INFINITY;
        let near = params.positions.around(outward).map(|(site, _)| site);
        let axes = [Vec3::X, Vec3::Y, Vec3::Z].map(|axis| [axis, -axis]);
        let inside = point.length_squared() < 1.0;
        let axes = axes.iter().flatten().filter(|_| inside);
        for site in near
            .into_iter()
            .chain(axes.map(|&axis| params.positions.nearest(axis)))
        {
            let [x, y, z, _] = self.points[site as usize];
            let from = Vec3::new(x, y, z);
            let frame = Frame::new(-from);
            for cell in 0..params.cells() {
                let Some(local) = params.directions.of_cell(cell, params.resolution) else {
                    continue;
                };
                let distance = self
                    .samples
                    .distance(site as usize, cell, params.cells(), local.z);
                if distance.is_finite() {
                    let hit = from + distance * frame.to_world(local);
                    best = best.min(hit.distance_squared(point));
                }
            }
        }
        best.is_finite().then(|| best.sqrt())
    }
}
