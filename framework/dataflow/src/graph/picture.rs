//! A graph as a picture: Mermaid for documents, SVG for everything else.

use crate::graph::Graph;

impl Graph {
    /// A Mermaid flow chart.
    pub fn to_mermaid(&self) -> String {
        let mut text = String::from("flowchart LR\n");
        for instance in &self.instances {
            text.push_str(&format!("  {}[\"{}\"]\n", instance.path, instance.node_type.name));
        }
        text
    }

    /// An SVG document.
    pub fn to_svg(&self) -> String {
        "<svg xmlns=\"http://www.w3.org/2000/svg\"/>".to_owned()
    }
}
