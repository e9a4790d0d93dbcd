//! Fields in files: what was written comes back, and nothing else is taken for it.

mod support;

use std::{fs, path::Path};

use isophote_displacement_field::{Directions, Error, Field, FieldParams, Positions, Storage};
use isophote_scene::Error as SceneError;
use support::{coarse, field, torus};

const LIMIT: u64 = 1 << 30;

fn load(path: &Path) -> Result<Field, Error> {
    Field::load(path, LIMIT)
}

#[test]
fn fields_come_back() {
    let folder = tempfile::tempdir().unwrap();
    let torus = torus("torus", 24, 12, 0.4);
    for (index, storage) in Storage::ALL.into_iter().enumerate() {
        let params = FieldParams {
            storage,
            directions: Directions::ALL[index % 3],
            positions: [
                Positions::Slater { rings: 9 },
                Positions::Octahedral { side: 9 },
                Positions::PAPER_SPHERICAL,
            ][index % 3],
            resolution: 13,
            ..coarse()
        };
        let built = field(&torus, &params);
        let path = folder.path().join("a.field");
        let bytes = built.save(&path).unwrap();
        assert_eq!(bytes, fs::metadata(&path).unwrap().len());
        let loaded = load(&path).unwrap();
        assert_eq!(loaded.params(), &params);
        assert_eq!(loaded.sphere(), built.sphere());
        assert!(loaded.is_of(&torus) && !loaded.is_of(&support::torus("other", 24, 12, 0.41)));
        let again = folder.path().join("b.field");
        loaded.save(&again).unwrap();
        assert!(fs::read(&path).unwrap() == fs::read(&again).unwrap());
        let error = Field::load(&path, 1000).unwrap_err();
        assert!(matches!(error, Error::TooLarge { .. }), "{error}");
    }
}

#[test]
fn coding_halves_a_field() {
    let torus = torus("torus", 48, 24, 0.4);
    let field = field(&torus, &FieldParams::default());
    let coded = field.coded_bytes();
    assert!(2 * coded < field.bytes(), "{coded} {}", field.bytes());
}

#[test]
fn whatever_is_damaged_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.field");
    let params = FieldParams {
        positions: Positions::Slater { rings: 3 },
        resolution: 5,
        ..coarse()
    };
    field(&torus("torus", 8, 8, 0.4), &params)
        .save(&path)
        .unwrap();
    let whole = fs::read(&path).unwrap();
    let refused = |bytes: &[u8]| {
        fs::write(&path, bytes).unwrap();
        let error = load(&path).unwrap_err();
        assert!(
            matches!(
                error,
                Error::Scene(SceneError::Damaged { .. } | SceneError::Foreign { .. })
            ),
            "{error}"
        );
        assert!(error.to_string().contains("build the field anew"));
    };
    for length in 0..whole.len() {
        refused(&whole[..length]);
    }
    for index in 0..whole.len() {
        let mut bytes = whole.clone();
        bytes[index] ^= 0x10;
        refused(&bytes);
    }
    refused(&[&whole[..], &[0]].concat());
    refused(b"");
    assert!(matches!(
        load(&folder.path().join("none")),
        Err(Error::Scene(SceneError::Io { .. }))
    ));
    let error = field(&torus("torus", 8, 8, 0.4), &params).save(&folder.path().join("no/such/a"));
    assert!(matches!(error, Err(Error::Scene(_))));
}
