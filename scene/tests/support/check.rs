//! What must hold for every scene that a loader gives out, whatever the file.

use glam::Vec4;
use isophote_scene::{InstanceMask, Scene};

/// Panics if something in the scene refers to nothing, is not finite or out of its range.
pub(crate) fn check(scene: &Scene) {
    for mesh in &scene.meshes {
        let vertices = mesh.positions.len();
        assert!(!mesh.triangles.is_empty());
        assert_eq!(mesh.normals.len(), vertices);
        assert_eq!(mesh.triangle_materials.len(), mesh.triangles.len());
        assert!(
            mesh.uvs
                .iter()
                .all(|uvs| uvs.is_empty() || uvs.len() == vertices)
        );
        assert!(mesh.colors.is_empty() || mesh.colors.len() == vertices);
        let corners = mesh.triangles.as_flattened();
        assert!(corners.iter().all(|&corner| (corner as usize) < vertices));
        let materials = scene.materials.len();
        assert!(
            mesh.triangle_materials
                .iter()
                .all(|&m| (m as usize) < materials)
        );
        assert!(mesh.positions.iter().all(|position| position.is_finite()));
        assert!(
            mesh.normals
                .iter()
                .all(|normal| (normal.length() - 1.0).abs() < 1e-3)
        );
        assert!(mesh.uvs.iter().flatten().all(|uv| uv.is_finite()));
        let in_range = |color: &Vec4| color.min_element() >= 0.0 && color.max_element() <= 1.0;
        assert!(mesh.colors.iter().all(in_range));
    }
    for instance in &scene.instances {
        assert!((instance.mesh as usize) < scene.meshes.len());
        assert!(instance.transform.is_finite());
        assert!(instance.transform.inverse().is_finite());
        assert_eq!(
            instance.mask.contains(InstanceMask::STATIC),
            instance.node.is_none()
        );
    }
    assert!(scene.bounds().is_empty() || scene.bounds().diagonal().is_finite());
    for material in &scene.materials {
        let mut material = material.clone();
        assert!(
            material.base_color.min_element() >= 0.0 && material.base_color.max_element() <= 1.0
        );
        for factor in [material.metallic, material.roughness, material.transmission] {
            assert!((0.0..=1.0).contains(&factor));
        }
        assert!(material.emissive.is_finite() && material.emissive.min_element() >= 0.0);
        assert!(material.ior >= 1.0 && material.ior.is_finite());
        for texture in material.textures_mut() {
            assert!((texture.texture as usize) < scene.textures.len());
            assert!(texture.uv_set < 2 && texture.transform.is_finite());
        }
    }
    for light in &scene.lights {
        assert!(light.transform.is_finite() && light.intensity.is_finite());
        assert!(light.intensity.min_element() >= 0.0);
    }
    for camera in &scene.cameras {
        assert!(camera.transform.is_finite());
    }
    check_animation(scene);
}

fn check_animation(scene: &Scene) {
    for (index, node) in scene.animation.nodes.iter().enumerate() {
        assert!(node.parent.is_none_or(|parent| (parent as usize) < index));
    }
    let duration = scene.animation.duration();
    assert!(duration.is_finite());
    let mut moved = scene.clone();
    for seconds in [-1.0, 0.0, 0.3 * duration, duration, 2.0 * duration] {
        moved.set_time(seconds);
        assert!(
            moved
                .instances
                .iter()
                .all(|instance| !instance.transform.is_nan())
        );
    }
}
