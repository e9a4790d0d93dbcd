//! Measures how close joint bilateral upsampling comes to the full resolution at silhouettes, as JSON lines:
//! `cargo run --release -p isophote-filters --example silhouettes -- SCENE [WIDTH HEIGHT [SAMPLES [FACTOR]]]`
//!
//! SCENE is a glTF file or `builtin:NAME`; `cargo xtask bench filters` runs this on several. The irradiance is the
//! indirect one at the pixels' centres, the materials diffuse, the seed 0, the tracer `BvhTracer`.

#[path = "../tests/common/irradiance.rs"]
mod irradiance;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let scene = arguments.first().ok_or("which scene?")?;
    let number = |index: usize, default: usize| -> Result<usize, std::num::ParseIntError> {
        arguments
            .get(index)
            .map_or(Ok(default), |text| text.parse())
    };
    let size = [number(1, 800)?, number(2, 600)?];
    let (samples, factor) = (number(3, 256)?, number(4, 4)?);
    let errors = irradiance::render(scene, size, samples as u32).errors(factor);
    println!(
        "{{\"scene\": {scene:?}, \"size\": {size:?}, \"samples\": {samples}, \"seed\": 0, \
         \"tracer\": \"bvh\", \"factor\": {factor}, \
         \"silhouette_pixels\": {:.3}, \"noise\": {:.4}, \"constant\": {:.4}, \"bicubic\": {:.4}, \
         \"bicubic_of_block_means\": {:.4}, \"cosine_weight\": {:.4}, \"joint_bilateral\": {:.4}, \
         \"bicubic_over_joint_bilateral\": {:.3}}}",
        errors.share,
        errors.noise,
        errors.constant,
        errors.bicubic,
        errors.bicubic_of_means,
        errors.cosine,
        errors.joint_bilateral,
        errors.bicubic / errors.joint_bilateral,
    );
    Ok(())
}
