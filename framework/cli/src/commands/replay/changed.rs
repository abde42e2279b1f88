//! A replay with other settings, from some node on, or of another rig.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use foveate_engine as engine;
use foveate_node::Registry;
use foveate_rig::graph::Graph;
use foveate_rig::{self as rig, Overrides};
use foveate_session::replay::{self, Begin};
use foveate_session::{Session, attach, playback};

use super::super::run::{Faults, host};
use super::super::{complain, load_quietly};
use super::{ReplayArgs, into_folder, say_what_is_made};
use crate::exit;
use crate::output::wants_color;

/// Nodes that are added to a rig, where the replay begins.
pub(in super::super) struct Added {
    /// Their part of the rig.
    pub text: String,
    /// Their names, `scale.node`.
    pub nodes: Vec<String>,
    /// What was typed.
    pub command: String,
}

pub(in super::super) fn run(
    args: &ReplayArgs,
    mut session: Session,
    folder: &Path,
    registry: &Registry,
    added: Option<&Added>,
) -> u8 {
    let addition = added.map_or("", |it| &it.text);
    let graph = match load(args, &mut session, folder, &replay::registry(registry), addition) {
        Ok(graph) => graph,
        Err(code) => return code,
    };
    let begin = match added {
        Some(added) => Ok(Begin { nodes: added.nodes.clone(), scales: Vec::new() }),
        None => begin(args),
    };
    let made = begin.and_then(|begin| replay::made(&graph, &session, &begin));
    let (made, remarks) = match made {
        Ok(made) => made,
        Err(sentence) => return complain(&sentence),
    };
    if !args.quiet && added.is_none() {
        say_what_is_made(&graph, made.iter().filter(|it| **it).count(), &remarks);
    }
    let mut graph = match playback::in_place(graph, &made, session) {
        Ok(graph) => graph,
        Err(sentence) => return complain(&sentence),
    };
    graph.host = host(!args.quiet, Faults::default());
    // The folder of the session's files goes away.
    let command = added.map_or_else(|| command(args), |it| it.command.clone());
    graph.resolved = format!("# {command}\n{}", attach::without_folder(&graph.resolved));
    let graph = Arc::new(graph);
    into_folder(args, &graph, |options, observe| engine::deterministic(Arc::clone(&graph), options, observe))
}

/// The rig of the session, or the one that is given in its place, with the changed settings.
fn load(
    args: &ReplayArgs,
    session: &mut Session,
    folder: &Path,
    registry: &Registry,
    addition: &str,
) -> Result<Graph, u8> {
    let overrides = Overrides::default();
    let (path, mut text): (PathBuf, String) = match &args.rig {
        Some(path) => (path.clone(), load_quietly(path, registry, &overrides)?.resolved),
        None => replay::unpack(session, folder).map_err(|sentence| complain(&sentence))?,
    };
    for it in &args.set {
        let changed = setting(it).and_then(|(path, value)| replay::with_setting(&text, path, value));
        text = changed.map_err(|sentence| complain(&sentence))?;
    }
    text += addition;
    rig::load(&text, &path, registry, &overrides).map_err(|faults| {
        eprint!("{}", faults.render(wants_color()));
        exit::INPUT
    })
}

/// The replay as it is typed.
fn command(args: &ReplayArgs) -> String {
    let each = |flag: &str, all: &[String]| all.iter().map(|it| format!(" {flag} {it}")).collect::<String>();
    let rig = args.rig.as_ref().map_or_else(String::new, |it| format!(" --rig {}", it.display()));
    let what = each("--from", &args.from) + &each("--from-scale", &args.from_scale) + &each("--set", &args.set) + &rig;
    format!("foveate replay {}{what}", args.session.display())
}

fn setting(text: &str) -> Result<(&str, &str), String> {
    text.split_once('=')
        .map(|(path, value)| (path.trim(), value.trim()))
        .ok_or_else(|| format!("found `{text}`, expected SCALE.NODE.SETTING=VALUE as `face.marks.window_px=21`"))
}

/// Where the replay begins: where the person says, or else at the nodes whose settings change.
fn begin(args: &ReplayArgs) -> Result<Begin, String> {
    let mut begin = Begin { nodes: args.from.clone(), scales: args.from_scale.clone() };
    if begin == Begin::default() && args.rig.is_none() {
        for it in &args.set {
            let mut parts = setting(it)?.0.splitn(3, '.');
            begin.nodes.extend(parts.next().zip(parts.next()).map(|(scale, node)| format!("{scale}.{node}")));
        }
    }
    Ok(begin)
}
