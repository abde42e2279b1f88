//! What an evaluation leaves for another to go on with: what it was begun with, and of each seed how its run ended.

use std::fs;
use std::path::Path;

use foveate_node::figure::Better;
use serde_json::{Value, json};

use super::{CALIBRATED, EvalArgs};
use crate::evaluation::SeedRun;
use crate::results;

/// What an evaluation was begun with.
const BEGUN_FILE: &str = "eval.begun.json";
/// In the folder of a seed: how its run ended.
pub(super) const RUN_FILE: &str = "run.json";

/// What decides how a seed comes out, apart from this program.
pub(super) struct Begun(Value);

impl Begun {
    pub(super) fn of(args: &EvalArgs) -> Begun {
        // That it can be read was seen before.
        let rig = fs::read_to_string(&args.rig).unwrap_or_default();
        Begun(json!({ "rig": rig, "duration_s": args.duration, "calibrate": args.calibrate }))
    }

    /// That there is no evaluation in `folder`.
    pub(super) fn none_in(folder: &Path) -> Result<(), String> {
        let is_there = ["eval.json", BEGUN_FILE].iter().any(|it| folder.join(it).exists());
        let folder = folder.display();
        let how = "name another one with --out, or go on with this one by --resume";
        if is_there {
            Err(format!("`{folder}` holds an evaluation already; expected a folder of its own: {how}"))
        } else {
            Ok(())
        }
    }

    /// That the evaluation in `folder` was begun with the same.
    pub(super) fn is_that_of(&self, folder: &Path) -> Result<(), String> {
        let path = folder.join(BEGUN_FILE);
        let text = fs::read_to_string(&path)
            .map_err(|error| format!("`{}`: {error}; expected an evaluation that was begun there", path.display()))?;
        let before: Value = serde_json::from_str(&text)
            .map_err(|error| format!("`{}`: {error}; expected what an evaluation wrote", path.display()))?;
        let other = ["rig", "duration_s", "calibrate"].into_iter().find(|it| before[*it] != self.0[*it]);
        let (place, said) = (folder.display(), |it: &Value| it.to_string());
        match other {
            None => Ok(()),
            Some("rig") => {
                Err(format!("the evaluation in `{place}` was begun with another text of the rig; expected the same"))
            }
            Some(what) => Err(format!(
                "the evaluation in `{place}` was begun with `{what}` {}, found {}; expected the same",
                said(&before[what]),
                said(&self.0[what])
            )),
        }
    }

    pub(super) fn write(&self, folder: &Path) -> Result<(), String> {
        results::write_whole(&folder.join(BEGUN_FILE), format!("{:#}\n", self.0).as_bytes())
    }
}

/// Notes how the run of a seed ended, in its folder.
pub(super) fn write(run: &SeedRun, folder: &Path) -> Result<(), String> {
    let text = json!({ "code": run.code, "said": run.said, CALIBRATED: run.figures.get(CALIBRATED) });
    results::write_whole(&folder.join(RUN_FILE), format!("{text:#}\n").as_bytes())
}

/// The run of a seed that came to its end before, from its folder.
pub(super) fn taken(seed: u64, folder: &Path) -> Option<SeedRun> {
    let end: Value = serde_json::from_str(&fs::read_to_string(folder.join(RUN_FILE)).ok()?).ok()?;
    let summary = fs::read_to_string(folder.join("summary.json")).ok()?;
    let code = end["code"].as_u64().and_then(|it| u8::try_from(it).ok());
    let mut run = SeedRun::read(seed, code, end["said"].as_str()?, Some(&summary));
    if let Some(calibrated_s) = end[CALIBRATED].as_f64() {
        run.figures.insert(CALIBRATED.to_owned(), calibrated_s);
        run.about.insert(CALIBRATED.to_owned(), ("s".to_owned(), Better::Neither));
    }
    run.is_whole.then_some(run)
}
