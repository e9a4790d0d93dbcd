//! Whether many virtual lights give the right answer, and whether compensation gives back what the bound takes.

use serde_json::{Value, json};

use super::{Measured, conference, cornell, office};
use crate::paper::{
    lab::{Lab, number},
    page::{Part, Section},
    report::{cells, percent, signed},
};

const TEXT: &str = "4096 light paths of one bounce and no shortcuts against the reference integrator's `indirect`, both at the \
    points that pixels' centres show, both with the same bound of 0.1 m; from a lattice for each light, from a lattice of eight times as many paths of \
    whose lights 4096 are kept for the picture, and from the paper's Halton sequence. The last rows bound at 0.4 m, find what that leaves out by 64 rays a point, and are compared with the unbounded \
    reference. relRMSE is given as measured and without the reference's own noise, \
    which two halves of its samples tell; 'constant' is what the reference's mean would have for an error. Aims: relRMSE 4 %, bias \
    1.5 %; compensated, bias 2 %. The paper shows pictures alone.";

pub(super) fn measure(lab: &Lab) -> Measured {
    let size = match lab.quick {
        true => ["--size", "48x36", "--samples", "128"],
        false => ["--size", "120x90", "--samples", "4096"],
    };
    let compensated = ["--min-d", "0.4", "--compensation", "64", "--unbounded"];
    let uncompensated = ["--min-d", "0.4", "--unbounded"];
    let kept = ["--paths", "32768", "--keep", "4096"];
    let cases: [(_, _, &[&str]); 13] = [
        (cornell(lab), "bound at 0.1 m", &[]),
        (office(lab), "bound at 0.1 m", &[]),
        (conference(lab), "bound at 0.1 m", &[]),
        (cornell(lab), "bound at 0.1 m, kept of 32,768", &kept),
        (office(lab), "bound at 0.1 m, kept of 32,768", &kept),
        (conference(lab), "bound at 0.1 m, kept of 32,768", &kept),
        (cornell(lab), "bound at 0.1 m, Halton", &["--halton"]),
        (office(lab), "bound at 0.1 m, Halton", &["--halton"]),
        (conference(lab), "bound at 0.1 m, Halton", &["--halton"]),
        (
            cornell(lab),
            "bound at 0.4 m, not compensated",
            &uncompensated,
        ),
        (cornell(lab), "bound at 0.4 m, compensated", &compensated),
        (office(lab), "bound at 0.4 m, compensated", &compensated),
        (conference(lab), "bound at 0.4 m, compensated", &compensated),
    ];
    let (mut rows, mut numbers) = (Vec::new(), Vec::new());
    for (scene, what, flags) in cases {
        let flags = [&size[..], flags].concat();
        for line in lab.bench(["isophote-instant-gi", "truth"], &scene, &flags)? {
            rows.push(vec![
                scene.title.clone(),
                what.to_owned(),
                line["vpls"].to_string(),
                percent(number(&line, "/rel_rmse")?),
                percent(number(&line, "/noise")?),
                percent(number(&line, "/rel_rmse_beyond")?),
                signed(number(&line, "/bias")?),
                percent(number(&line, "/constant")?),
            ]);
            numbers.push(json!({ "title": scene.title, "what": what, "measured": line }));
        }
    }
    let head = cells([
        "scene",
        "light",
        "virtual lights",
        "relRMSE",
        "reference's noise",
        "relRMSE beyond it",
        "bias",
        "constant",
    ]);
    let section = Section {
        id: "convergence",
        title: "Convergence to the reference",
        parts: vec![Part::Text(TEXT.to_owned()), Part::Table { head, rows }],
    };
    Ok((section, Value::Array(numbers)))
}
