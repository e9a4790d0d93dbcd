//! Times the 11×11 Gaussian at 1920×1080×3 in one thread and prints JSON.
//!
//! `ISOPHOTE_PYTHON=/path/to/python cargo bench -p isophote-filters --bench gaussian` times `GaussianBlur`
//! of the package `opencv-python-headless` beside it, in turns, so that a busy machine slows both alike.

use std::{
    env,
    error::Error,
    fs,
    io::{BufRead, BufReader, Write},
    process::{Child, ChildStdin, ChildStdout, Command, Stdio},
    time::Instant,
};

use isophote_filters::{Gaussian, ImageView};

const SIZE: [usize; 3] = [1920, 1080, 3];
const WIDTH: usize = 11;
const SIGMA: f32 = 2.0;
const ROUNDS: usize = 40;
const REPEATS: usize = 5;

fn main() -> Result<(), Box<dyn Error>> {
    let [width, height, channels] = SIZE;
    let mut state = 1_u32;
    let image: Vec<f32> = std::iter::repeat_with(|| {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (state >> 8) as f32 / 16_777_216.0
    })
    .take(width * height * channels)
    .collect();
    let view = ImageView::new(&image, width, height, channels)?;
    let gaussian = Gaussian::new(WIDTH, SIGMA)?;
    let mut output = vec![0.0; image.len()];
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build()?;
    let mut blur = || pool.install(|| gaussian.apply(view, &mut output));
    blur()?;
    let mut opencv = env::var("ISOPHOTE_PYTHON")
        .ok()
        .map(|python| OpenCv::start(&python, &image))
        .transpose()?;
    let (mut ours, mut theirs) = (Vec::new(), Vec::new());
    for _ in 0..ROUNDS {
        for _ in 0..REPEATS {
            let start = Instant::now();
            blur()?;
            ours.push(start.elapsed().as_secs_f64());
        }
        if let Some(opencv) = &mut opencv {
            theirs.extend(opencv.measure()?);
        }
    }
    println!("{{");
    println!(
        "  \"filter\": \"Gaussian {WIDTH}x{WIDTH}, {width}x{height}x{channels} f32, 1 thread\","
    );
    println!("  \"calls\": {},", ours.len());
    if let Some(opencv) = opencv {
        let difference = opencv.difference(&output)?;
        let median_ratio = median(&mut ours) / median(&mut theirs);
        println!("  \"opencv\": \"{}\",", opencv.version);
        println!("  \"opencv_median_ms\": {:.3},", 1e3 * median(&mut theirs));
        println!("  \"opencv_best_ms\": {:.3},", 1e3 * best(&theirs));
        println!("  \"largest_difference_inside\": {difference:e},");
        println!("  \"median_over_opencv\": {median_ratio:.3},");
        println!(
            "  \"best_over_opencv\": {:.3},",
            best(&ours) / best(&theirs)
        );
    }
    println!("  \"median_ms\": {:.3},", 1e3 * median(&mut ours));
    println!("  \"best_ms\": {:.3}", 1e3 * best(&ours));
    println!("}}");
    Ok(())
}

fn median(values: &mut [f64]) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

fn best(values: &[f64]) -> f64 {
    values.iter().copied().fold(f64::INFINITY, f64::min)
}

/// A Python process that blurs the same picture.
struct OpenCv {
    child: Child,
    input: ChildStdin,
    output: BufReader<ChildStdout>,
    version: String,
    path: std::path::PathBuf,
}

impl OpenCv {
    fn start(python: &str, image: &[f32]) -> Result<Self, Box<dyn Error>> {
        let path = env::temp_dir().join(format!("isophote-gaussian-{}", std::process::id()));
        let bytes: Vec<u8> = image.iter().flat_map(|value| value.to_le_bytes()).collect();
        fs::write(&path, bytes)?;
        let [width, height, channels] = SIZE.map(|side| side.to_string());
        let mut child = Command::new(python)
            .arg(concat!(env!("CARGO_MANIFEST_DIR"), "/benches/opencv.py"))
            .arg(&path)
            .args([
                width,
                height,
                channels,
                WIDTH.to_string(),
                SIGMA.to_string(),
            ])
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()?;
        let input = child.stdin.take().ok_or("no input")?;
        let mut output = BufReader::new(child.stdout.take().ok_or("no output")?);
        let mut version = String::new();
        output.read_line(&mut version)?;
        Ok(Self {
            child,
            input,
            output,
            version: version.trim().to_owned(),
            path,
        })
    }

    fn measure(&mut self) -> Result<Vec<f64>, Box<dyn Error>> {
        writeln!(self.input, "{REPEATS}")?;
        let mut line = String::new();
        self.output.read_line(&mut line)?;
        Ok(line
            .split_whitespace()
            .map(str::parse)
            .collect::<Result<_, _>>()?)
    }

    /// Largest difference of the two results where no tap leaves the picture.
    fn difference(&self, ours: &[f32]) -> Result<f32, Box<dyn Error>> {
        let bytes = fs::read(self.path.with_extension("blurred"))?;
        let theirs = bytes
            .chunks_exact(4)
            .map(|bytes| f32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]));
        let [width, height, channels] = SIZE;
        let margin = WIDTH / 2;
        let inside = |index: usize| {
            let (x, y) = (index / channels % width, index / channels / width);
            (margin..width - margin).contains(&x) && (margin..height - margin).contains(&y)
        };
        let pairs = ours.iter().zip(theirs).enumerate();
        Ok(pairs
            .filter(|(index, _)| inside(*index))
            .map(|(_, (ours, theirs))| (ours - theirs).abs())
            .fold(0.0, f32::max))
    }
}

impl Drop for OpenCv {
    fn drop(&mut self) {
        // It ends by itself when its input does; what fails here fails after the measurement.
        let _ = self.child.kill();
        let _ = self.child.wait();
        let _ = fs::remove_file(self.path.with_extension("blurred"));
        let _ = fs::remove_file(&self.path);
    }
}
