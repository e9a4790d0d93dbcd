//! What fields cost and what they get wrong, beside the exact tracer on the same rays: one line of JSON for each setting.
//!
//! ```sh
//! cargo bench -p isophote-displacement-field --bench trace -- SCENE... [--case CASE]... [--speed] [--memory] [--parts N]...
//! cargo bench -p isophote-displacement-field --bench trace -- --growth TRIANGLES...
//! cargo bench -p isophote-displacement-field --bench trace -- SCENE... --together | --moving INSTANCES
//! ```
//!
//! A case is `POSITIONSxRESOLUTION[:DIRECTIONS[:STORAGE[:LOOKUP]]]`, such as 4226x32:concentric:byte:aimed; 1122 positions are
//! spherical coordinates, squares are octahedral maps, the others Slater's. The object stands on the floor of a corner of
//! three planes of 33 × 33 vertices, which receive and do not cast; 256 rays a vertex by the same directions. Errors are
//! RMS over the vertices in grey levels, by the same rays, of the exact tracer and of the first case of 32 bits that differs
//! in nothing else. Rates are of one thread, tracing alone, the best of three; `run_seconds` is once all of a case's rays.

mod corner;
mod group;
mod growth;
mod moving;

use std::{path::Path, sync::Arc};

use isophote_displacement_field::{Directions, FieldParams, LookUp, Positions, Storage};
use isophote_scene::{Scene, builtin, load};

use corner::Corner;

/// What is measured.
#[derive(Default)]
struct Arguments {
    scenes: Vec<String>,
    cases: Vec<Case>,
    speed: bool,
    memory: bool,
    parts: Vec<u32>,
    growth: Vec<usize>,
    moving: Option<usize>,
    together: bool,
}

/// A field and how it is asked.
#[derive(Clone, Copy)]
struct Case {
    params: FieldParams,
    look_up: LookUp,
}

impl Case {
    /// Whether another case is the same but for what is kept of each ray.
    fn is_but_stored_as(&self, other: &Self) -> bool {
        let storage = other.params.storage;
        let params = FieldParams {
            storage,
            ..self.params
        };
        params == other.params && self.look_up == other.look_up
    }
}

fn main() {
    let arguments = Arguments::parse(std::env::args().skip(1));
    if arguments.together {
        return group::measure(&arguments.scenes);
    }
    if let Some(instances) = arguments.moving {
        return moving::measure(instances, &arguments.scenes);
    }
    for name in &arguments.scenes {
        let corner = Corner::new(name, open(name));
        corner.measure_all(&arguments.cases, arguments.speed, arguments.memory);
        for &parts in &arguments.parts {
            corner.measure_parts(parts);
        }
    }
    if !arguments.growth.is_empty() {
        growth::measure(&arguments.growth);
    }
}

fn open(name: &str) -> Arc<Scene> {
    let scene = match builtin::is_builtin(name) {
        true => builtin::build(name),
        false => load(Path::new(name)),
    };
    Arc::new(scene.expect("a scene"))
}

impl Arguments {
    fn parse(words: impl Iterator<Item = String>) -> Self {
        let mut words = words.peekable();
        let mut arguments = Self::default();
        while let Some(word) = words.next() {
            let mut value = || words.next().expect("a value");
            match word.as_str() {
                // Cargo's own.
                "--bench" => {}
                "--case" => arguments.cases.push(case(&value())),
                "--speed" => arguments.speed = true,
                "--memory" => arguments.memory = true,
                "--together" => arguments.together = true,
                "--parts" => arguments.parts.push(value().parse().expect("a number")),
                "--moving" => arguments.moving = Some(value().parse().expect("a number")),
                "--growth" => {
                    while let Some(count) = words.next_if(|word| !word.starts_with("--")) {
                        arguments.growth.push(count.parse().expect("a number"));
                    }
                }
                flag if flag.starts_with("--") => panic!("what is {flag}?"),
                scene => arguments.scenes.push(scene.into()),
            }
        }
        if arguments.growth.is_empty() && arguments.moving.is_none() && arguments.scenes.is_empty()
        {
            arguments.scenes.push("builtin:cave".into());
        }
        let measures_others = !arguments.parts.is_empty() || !arguments.growth.is_empty();
        if arguments.cases.is_empty() && !measures_others {
            arguments.cases.push(case("4226x32"));
        }
        arguments
    }
}

fn case(text: &str) -> Case {
    let mut parts = text.split(':');
    let (positions, resolution) = parts
        .next()
        .and_then(|size| size.split_once('x'))
        .expect("POSITIONSxRESOLUTION");
    let count: u32 = positions.parse().expect("a number");
    let rings = (1..=256).find(|n| 2 * (2 * n * n + 2 * n + 1) == count);
    let default = FieldParams::default();
    Case {
        params: FieldParams {
            positions: match rings {
                Some(rings) => Positions::Slater { rings },
                None if count == 1122 => Positions::PAPER_SPHERICAL,
                None => Positions::Octahedral {
                    side: count.isqrt(),
                },
            },
            resolution: resolution.parse().expect("a number"),
            directions: match parts.next() {
                None | Some("concentric") => Directions::Concentric,
                Some("polar") => Directions::Polar,
                Some("rejection") => Directions::Rejection,
                Some(other) => panic!("what is {other}?"),
            },
            storage: match parts.next() {
                None | Some("byte") => Storage::Byte,
                Some("float") => Storage::Float,
                Some("word") => Storage::Word,
                Some("bit") => Storage::Bit,
                Some(other) => panic!("what is {other}?"),
            },
            ..default
        },
        look_up: match parts.next() {
            Some("nearest") => LookUp::Nearest,
            None | Some("aimed") => LookUp::Aimed,
            Some("interpolated") => LookUp::Interpolated,
            Some(other) => panic!("what is {other}?"),
        },
    }
}
