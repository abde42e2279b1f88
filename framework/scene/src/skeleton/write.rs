//! Writes BVH.

use std::fmt::Write;

use super::{Channel, SkeletonMotion};

impl SkeletonMotion {
    /// The text of a BVH file; numbers are written with as many digits as identify them exactly.
    pub fn to_bvh(&self) -> String {
        let mut text = String::from("HIERARCHY\n");
        // Children in the order in which they stand, for the numbers of a frame follow the hierarchy.
        self.write_joint(&mut text, 0, 0);
        let (n_channels, n_frames) = (self.n_channels(), self.n_frames());
        // Writing to a string does not fail.
        writeln!(text, "MOTION\nFrames: {n_frames}\nFrame Time: {}", self.frame_s).ok();
        for frame in self.values.chunks_exact(n_channels.max(1)) {
            for (place, value) in frame.iter().enumerate() {
                write!(text, "{}{value}", if place == 0 { "" } else { " " }).ok();
            }
            text.push('\n');
        }
        text
    }

    fn write_joint(&self, text: &mut String, index: usize, depth: usize) {
        let Some(joint) = self.joints.get(index) else { return };
        let indent = "\t".repeat(depth);
        let kind = if joint.parent.is_none() { "ROOT" } else { "JOINT" };
        let [x, y, z] = joint.offset.into();
        write!(text, "{indent}{kind} {}\n{indent}{{\n{indent}\tOFFSET {x} {y} {z}\n", joint.name).ok();
        write!(text, "{indent}\tCHANNELS {}", joint.channels.len()).ok();
        for channel in &joint.channels {
            match channel {
                Channel::Position(axis) => write!(text, " {axis:?}position").ok(),
                Channel::Rotation(axis) => write!(text, " {axis:?}rotation").ok(),
            };
        }
        text.push('\n');
        for child in index + 1..self.joints.len() {
            if self.joints[child].parent == Some(index) {
                self.write_joint(text, child, depth + 1);
            }
        }
        if let Some(end) = joint.end {
            let [x, y, z] = end.into();
            write!(text, "{indent}\tEnd Site\n{indent}\t{{\n{indent}\t\tOFFSET {x} {y} {z}\n{indent}\t}}\n").ok();
        }
        writeln!(text, "{indent}}}").ok();
    }
}
