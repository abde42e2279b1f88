//! Live settings that pages change, and how they get into the rig.

use std::sync::mpsc::{Receiver, Sender, channel};
use std::time::Instant;

use foveate_engine::controls::Change;
use foveate_node::given::Table;
use foveate_node::page::Client;
use foveate_rig::live;
use serde_json::json;

use super::Desk;
use crate::settings::{self, Changed, in_json};
use crate::source::Source;

/// What one change of settings has come to.
pub(super) struct Asked {
    client: Client,
    number: Option<i64>,
    node: usize,
    values: Table,
    /// Instances that have not answered yet.
    waiting: usize,
    refused: Option<String>,
    answers: Receiver<Result<(), String>>,
}

impl Desk {
    /// Lets all instances of a node take other settings; the answer follows when they have.
    pub(super) fn set(
        &mut self,
        client: Client,
        node: usize,
        values: Table,
        number: Option<i64>,
    ) -> Result<(), String> {
        if matches!(self.source, Source::Session(_)) {
            return Err("a recording keeps its settings; `foveate replay --set` runs it with others".to_owned());
        }
        let instances = self.index.nodes[node].1.clone();
        let first = &self.graph.instances[instances[0]];
        live::changed(first, &*first.settings, &values).map_err(|it| in_words(&it.setting, &it.message))?;
        let (answer, answers): (Sender<Result<(), String>>, _) = channel();
        for &instance in &instances {
            let answer = answer.clone();
            let done = Box::new(move |it| drop(answer.send(it)));
            self.controls.change(Change { instance, values: values.clone(), done })?;
        }
        self.asked.push(Asked { client, number, node, values, waiting: instances.len(), refused: None, answers });
        Ok(())
    }

    /// Answers changes of settings that all instances have taken, or one has refused.
    pub(super) fn settle(&mut self) {
        let mut rest = Vec::new();
        for mut it in std::mem::take(&mut self.asked) {
            while let Ok(answer) = it.answers.try_recv() {
                it.waiting -= 1;
                it.refused = it.refused.or(answer.err());
            }
            if it.waiting > 0 {
                rest.push(it);
                continue;
            }
            let outcome = match it.refused {
                Some(what) => Err(what),
                None => {
                    self.changed.entry(it.node).or_default().extend(it.values.clone());
                    let message = settings_message(it.node, &it.values);
                    for window in &self.windows {
                        self.link.send(window.client, &message);
                    }
                    Ok("changed".to_owned())
                }
            };
            self.next_state = Instant::now();
            self.answer(it.client, it.number, outcome);
        }
        self.asked = rest;
    }

    /// Scale and node, and the names of their settings that the rig file does not have yet.
    pub(super) fn unsaved(&self) -> Vec<String> {
        let names = |(node, values): (&usize, &Table)| {
            let node = self.index.nodes[*node].0.clone();
            values.keys().map(move |it| format!("{node}.{it}")).collect::<Vec<_>>()
        };
        self.changed.iter().flat_map(names).collect()
    }

    pub(super) fn save(&mut self) -> Result<String, String> {
        let path = self.rig.as_ref().ok_or("there is no rig file to save to")?;
        let mut changed = Vec::new();
        for (node, values) in &self.changed {
            let first = &self.graph.instances[self.index.nodes[*node].1[0]];
            let node = [self.graph.scales[first.scale].name.clone(), first.node.clone()];
            let of_node = values.iter().map(|(name, value)| Changed {
                node: node.clone(),
                name: name.clone(),
                value: value.clone(),
            });
            changed.extend(of_node);
        }
        if changed.is_empty() {
            return Err("nothing has changed".to_owned());
        }
        settings::save(path, &changed)?;
        let words = format!("saved {} settings to {}", changed.len(), path.display());
        // Windows that open later learn the values all the same.
        for (node, values) in std::mem::take(&mut self.changed) {
            self.remember(node, &values);
        }
        Ok(words)
    }

    /// Puts values into what windows learn first.
    fn remember(&mut self, node: usize, values: &Table) {
        let settings = self.hello["nodes"][node]["settings"].as_array_mut();
        for it in settings.into_iter().flatten() {
            let value = it["name"].as_str().and_then(|name| in_json(values).get(name).cloned());
            if let Some(value) = value {
                it["value"] = value;
            }
        }
    }
}

pub(super) fn settings_message(node: usize, values: &Table) -> String {
    json!({ "say": "settings", "node": node, "values": in_json(values) }).to_string()
}

fn in_words(setting: &Option<String>, message: &str) -> String {
    setting.as_ref().map_or_else(|| message.to_owned(), |it| format!("`{it}`: {message}"))
}
