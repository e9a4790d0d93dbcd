//! Damaged files: nothing panics, hangs or allocates above 1 GiB, and what loads is a scene that can be rendered.
//!
//! `ISOPHOTE_FUZZ_COUNT` says how many files to try; 10,000 unless set. The same count gives the same files.
#![cfg(all(feature = "gltf", feature = "obj"))]
#![expect(clippy::unwrap_used, reason = "a test may fail")]

mod support;

use std::{
    alloc::{GlobalAlloc, Layout, System},
    panic::{AssertUnwindSafe, catch_unwind},
    path::{Path, PathBuf},
    sync::{
        Mutex,
        atomic::{AtomicUsize, Ordering::Relaxed},
    },
    time::{Duration, Instant},
};

use isophote_scene::load;
use support::{Files, check::check, gltf::glb, seeds};

/// The system's allocator, which keeps count.
struct Counting;

static HELD: AtomicUsize = AtomicUsize::new(0);
static PEAK: AtomicUsize = AtomicUsize::new(0);

#[global_allocator]
static ALLOCATOR: Counting = Counting;

// SAFETY: every call is passed on to the system's allocator unchanged.
#[expect(unsafe_code, reason = "an allocator that counts has to be one")]
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        take(layout.size());
        // SAFETY: the caller's layout.
        unsafe { System.alloc(layout) }
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        take(layout.size());
        // SAFETY: the caller's layout.
        unsafe { System.alloc_zeroed(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        HELD.fetch_sub(layout.size(), Relaxed);
        // SAFETY: the caller's pointer and layout.
        unsafe { System.dealloc(pointer, layout) }
    }

    unsafe fn realloc(&self, pointer: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        // For a moment both can be there.
        take(size);
        HELD.fetch_sub(layout.size(), Relaxed);
        // SAFETY: the caller's pointer, layout and size.
        unsafe { System.realloc(pointer, layout, size) }
    }
}

fn take(bytes: usize) {
    let held = HELD.fetch_add(bytes, Relaxed) + bytes;
    PEAK.fetch_max(held, Relaxed);
}

/// `SplitMix64` (Steele, Lea and Flood 2014).
struct Random(u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ (z >> 31)
    }

    /// A number below `end`, 0 if there is none.
    fn below(&mut self, end: usize) -> usize {
        if end == 0 {
            0
        } else {
            (self.next() % end as u64) as usize
        }
    }

    fn pick<'a, T>(&mut self, values: &'a [T]) -> &'a T {
        &values[self.below(values.len())]
    }

    fn range(&mut self, end: usize) -> std::ops::Range<usize> {
        let (a, b) = (self.below(end + 1), self.below(end + 1));
        // Short pieces are more telling than long ones.
        let length = a.abs_diff(b).min(1 << self.below(16));
        a.min(b)..a.min(b) + length
    }
}

/// Numbers at the edges of types, and things that are no numbers.
const WORDS: &[&str] = &[
    "0",
    "1",
    "-1",
    "2",
    "3",
    "4",
    "7",
    "100",
    "255",
    "256",
    "65535",
    "65536",
    "1000000",
    "2147483647",
    "4294967295",
    "4294967296",
    "9007199254740993",
    "18446744073709551615",
    "-9223372036854775808",
    "1e9",
    "1e18",
    "1e38",
    "-1e39",
    "1e300",
    "1e999",
    "1e-45",
    "0.5",
    "1.0",
    "nan",
    "\"x\"",
    "null",
    "[]",
    "{}",
    "true",
    "5126",
    "5120",
    "/",
    "//1",
    "-",
    ".",
    "\\",
    "#",
];

/// Damages bytes, whatever they mean.
fn damage_bytes(bytes: &mut Vec<u8>, other: &[u8], random: &mut Random) {
    match random.below(6) {
        0 => {
            for _ in 0..=random.below(8) {
                let at = random.below(bytes.len());
                if let Some(byte) = bytes.get_mut(at) {
                    *byte ^= 1 << random.below(8);
                }
            }
        }
        1 => bytes.truncate(random.below(bytes.len())),
        2 => drop(bytes.drain(random.range(bytes.len()))),
        3 => {
            let (from, to) = (random.range(other.len()), random.range(bytes.len()));
            bytes.splice(to, other[from].iter().copied());
        }
        4 => {
            let range = random.range(bytes.len());
            let value = *random.pick(&[0, 0x7F, 0x80, 0xFF]);
            bytes[range].fill(value);
        }
        _ => {
            let range = random.range(bytes.len());
            let copy = bytes[range].to_vec();
            let at = random.below(bytes.len() + 1);
            bytes.splice(at..at, copy);
        }
    }
}

/// Replaces some words of a text by others.
fn damage_words(bytes: &mut Vec<u8>, random: &mut Random) {
    for _ in 0..=random.below(3) {
        let is_word = |byte: &u8| byte.is_ascii_alphanumeric() || b"+-.".contains(byte);
        let start = random.below(bytes.len());
        let Some(start) = bytes[start..].iter().position(is_word).map(|at| start + at) else {
            continue;
        };
        let length = bytes[start..]
            .iter()
            .take_while(|byte| is_word(byte))
            .count();
        let word = random.pick(WORDS).bytes();
        bytes.splice(start..start + length, word);
    }
}

/// Damages one of the files; a `.glb` is taken apart and put together again, most of the time.
fn damage(files: &Files, others: &[Files], random: &mut Random) -> Files {
    let mut files = files.clone();
    let other = random.pick(others).0[0].1.clone();
    let which = random.below(files.0.len());
    let bytes = &mut files.0[which].1;
    for _ in 0..=random.below(2) {
        let chunks = glb_chunks(bytes).filter(|_| random.below(4) > 0);
        let Some((mut json, mut buffer)) = chunks else {
            if random.below(2) == 0 {
                damage_bytes(bytes, &other, random);
            } else {
                damage_words(bytes, random);
            }
            continue;
        };
        match random.below(4) {
            0 => damage_bytes(&mut buffer, &other, random),
            1 => damage_bytes(&mut json, &other, random),
            _ => damage_words(&mut json, random),
        }
        *bytes = glb(&json, &buffer);
    }
    files
}

fn glb_chunks(bytes: &[u8]) -> Option<(Vec<u8>, Vec<u8>)> {
    let rest = bytes.strip_prefix(b"glTF")?.get(8..)?;
    let chunk = |rest: &[u8]| -> Option<(Vec<u8>, usize)> {
        let size = u32::from_le_bytes(rest.get(..4)?.try_into().ok()?) as usize;
        Some((rest.get(8..size.checked_add(8)?)?.to_vec(), size + 8))
    };
    let (json, end) = chunk(rest)?;
    let (buffer, _) = chunk(&rest[end..])?;
    Some((json, buffer))
}

/// Loads files from a folder. Panics if they do not keep the promises; returns whether they loaded.
fn try_load(folder: &Path, files: &Files) -> (bool, usize, Duration) {
    for (name, content) in &files.0 {
        std::fs::write(folder.join(name), content).unwrap();
    }
    let before = HELD.load(Relaxed);
    PEAK.store(before, Relaxed);
    let start = Instant::now();
    let scene = load(&folder.join(&files.0[0].0));
    let (time, peak) = (start.elapsed(), PEAK.load(Relaxed) - before);
    assert!(peak <= 1 << 30, "{peak} bytes were allocated");
    assert!(time.as_secs() < 20, "loading took {time:?}");
    if let Ok(scene) = &scene {
        check(scene);
    } else if let Err(error) = &scene {
        assert!(!error.to_string().is_empty());
    }
    (scene.is_ok(), peak, time)
}

fn keep(folder: &Path, number: u64) -> PathBuf {
    let kept = Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("mutation-{number}"));
    let _ = std::fs::remove_dir_all(&kept);
    std::fs::create_dir_all(&kept).unwrap();
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        std::fs::copy(&path, kept.join(path.file_name().unwrap())).unwrap();
    }
    kept
}

/// Damages `ISOPHOTE_FUZZ_COUNT` files, made of the seeds in turn. Returns the share of those that loaded all the same.
fn damage_and_load(seeds: &[Files]) -> f64 {
    // What is allocated is counted for the whole process.
    static ALONE: Mutex<()> = Mutex::new(());
    let _alone = ALONE.lock();
    let count = std::env::var("ISOPHOTE_FUZZ_COUNT").map_or(10_000, |count| count.parse().unwrap());
    let folder = support::folder();
    let (mut loaded, mut most, mut longest) = (0, 0, Duration::ZERO);
    for number in 0..count {
        let mut random = Random(number);
        let files = damage(random.pick(seeds), seeds, &mut random);
        let Ok((success, peak, time)) =
            catch_unwind(AssertUnwindSafe(|| try_load(folder.path(), &files)))
        else {
            let kept = keep(folder.path(), number);
            panic!(
                "damaged file {number} did harm; it is kept in {}",
                kept.display()
            );
        };
        loaded += u64::from(success);
        most = most.max(peak);
        longest = longest.max(time);
    }
    let most = most >> 20;
    eprintln!("{loaded} of {count} damaged files loaded; at most {most} MiB and {longest:?} each");
    loaded as f64 / count as f64
}

#[test]
fn damaged_files_do_no_harm() {
    let seeds = seeds::all();
    for seed in &seeds {
        check(&seed.load().unwrap());
    }
    let loaded = damage_and_load(&seeds);
    // If nearly all or nearly none load, the damage is of the wrong kind.
    assert!(loaded > 0.1 && loaded < 0.9);
}

#[test]
fn damaged_models_of_others_do_no_harm() {
    let Some(folder) = support::shared("corpora") else {
        return;
    };
    let seeds: Vec<Files> = support::models(&folder)
        .iter()
        .map(|path| {
            let suffix = path.extension().unwrap().to_str().unwrap();
            Files::one(&format!("scene.{suffix}"), std::fs::read(path).unwrap())
        })
        .filter(|files| files.0[0].1.len() < 50_000)
        .collect();
    damage_and_load(&seeds);
}
