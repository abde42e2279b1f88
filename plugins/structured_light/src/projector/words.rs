//! Messages between the projector's page and its node, as JSON.

use serde::{Deserialize, Serialize};

/// From the node to the page.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(rename_all = "lowercase")]
pub(super) enum ToPage {
    /// Sent first: what there is to show.
    Projector {
        /// Columns and rows [px].
        size: [u32; 2],
        /// Pictures of a set.
        count: usize,
    },
    /// Show one picture as soon as may be.
    Show { set: u64, index: usize },
    /// Show sets one after the other; 0 sets: on and on.
    Play { set: u64, sets: u64, hold_ms: f64, pause_ms: f64 },
    /// Show black.
    Rest(bool),
    /// Show nothing but these words: another window shows the patterns.
    Wait(String),
    /// The run is over.
    Over(String),
}

/// From the page to the node.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(super) enum FromPage {
    /// All pictures are loaded, and the window is the projector's.
    Ready(bool),
    /// The page cannot show the patterns: why.
    Unfit(String),
    /// A picture is shown.
    Shown {
        set: u64,
        index: usize,
        #[serde(flatten)]
        when: When,
    },
    /// Black is shown in place of pictures.
    Black(When),
    /// A person pressed the key for the next picture.
    Key(bool),
}

/// When the page began to show something.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
pub(super) struct When {
    /// The frame in which it was drawn, on the server's clock [ms].
    pub at: f64,
    /// By how much that may be off [ms].
    pub sigma_ms: f64,
    /// By how much the next frame came late: the screen may have shown it so much later [ms].
    pub slip_ms: f64,
    /// Between two frames [ms].
    pub refresh_ms: f64,
}

impl ToPage {
    pub(super) fn text(&self) -> String {
        // Numbers and words can always be written.
        serde_json::to_string(self).unwrap_or_default()
    }
}

impl FromPage {
    /// What a page said.
    ///
    /// # Errors
    /// What is wrong with it.
    pub(super) fn read(text: &str) -> Result<FromPage, String> {
        let message: FromPage = serde_json::from_str(text).map_err(|fault| fault.to_string())?;
        match &message {
            FromPage::Shown { when, .. } | FromPage::Black(when) => when.check().map(|()| message),
            _ => Ok(message),
        }
    }
}

impl When {
    fn check(&self) -> Result<(), String> {
        // A year, and a minute: longer than any run, and any frame.
        let fits = |it: f64, most: f64| (0.0..=most).contains(&it);
        let all = [self.sigma_ms, self.slip_ms, self.refresh_ms];
        if self.refresh_ms > 0.0 && fits(self.at, 3.2e10) && all.iter().all(|it| fits(*it, 60e3)) {
            Ok(())
        } else {
            Err(format!("found {self:?}, expected times from 0, less than a minute but for `at`"))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_are_those_of_the_page() {
        assert_eq!(ToPage::Show { set: 3, index: 7 }.text(), r#"{"show":{"set":3,"index":7}}"#);
        assert_eq!(ToPage::Rest(true).text(), r#"{"rest":true}"#);
        let when = r#""at":12.5,"sigma_ms":0.3,"slip_ms":0,"refresh_ms":16.7"#;
        let shown = FromPage::read(&format!(r#"{{"shown":{{"set":1,"index":2,{when}}}}}"#));
        let expected = When { at: 12.5, sigma_ms: 0.3, slip_ms: 0.0, refresh_ms: 16.7 };
        assert_eq!(shown, Ok(FromPage::Shown { set: 1, index: 2, when: expected }));
        assert_eq!(FromPage::read(&format!(r#"{{"black":{{{when}}}}}"#)), Ok(FromPage::Black(expected)));
        assert_eq!(FromPage::read(r#"{"ready":true}"#), Ok(FromPage::Ready(true)));
        for wrong in [
            "",
            "{}",
            r#"{"shown":{}}"#,
            r#"{"black":{"at":-1,"sigma_ms":0,"slip_ms":0,"refresh_ms":0}}"#,
            r#"{"dance":1}"#,
        ] {
            assert!(FromPage::read(wrong).is_err(), "{wrong}");
        }
    }
}
