//! Upsampling real irradiance: joint bilateral against bicubic, at silhouettes.

#[path = "common/irradiance.rs"]
mod irradiance;

/// A small picture and few samples; `examples/silhouettes.rs` measures larger ones, in which thin things are wide
/// enough to be sampled and the ratio is above 2.
#[test]
fn joint_bilateral_upsampling_beats_bicubic_at_silhouettes() {
    let errors = irradiance::render("builtin:office", [160, 120], 64).errors(4);
    assert!(errors.share > 0.1, "{}", errors.share);
    assert!(errors.noise < errors.bicubic, "{}", errors.noise);
    assert!(errors.joint_bilateral < errors.bicubic_of_means.min(errors.constant));
    let ratio = errors.bicubic / errors.joint_bilateral;
    assert!(ratio > 1.4, "{ratio}");
    // Eq. (2) looks at normals alone: depths must repair some of what it gets wrong.
    let repair = errors.cosine / errors.joint_bilateral;
    assert!(repair > 1.05, "{repair}");
}
