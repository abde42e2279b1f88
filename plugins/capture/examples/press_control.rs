//! Sets a control of a video device by its name, also while another program streams from it: `press_control /dev/video0 Disconnect`.
//!
//! The test against the kernel's virtual cameras (`tests/vivid/run.sh`) injects faults with it.

use std::error::Error;

use v4l::Device;
use v4l::control::{Control, Type, Value};

fn main() -> Result<(), Box<dyn Error>> {
    let mut words = std::env::args().skip(1);
    let (Some(path), Some(name)) = (words.next(), words.next()) else {
        return Err("expected DEVICE CONTROL [NUMBER]".into());
    };
    let number = words.next().map(|it| it.parse()).transpose()?;
    let device = Device::with_path(path)?;
    let control = device.query_controls()?.into_iter().find(|it| it.name == name).ok_or("no control of that name")?;
    let value =
        if control.typ == Type::Button { Value::None } else { Value::Integer(number.ok_or("expected a number")?) };
    Ok(device.set_control(Control { id: control.id, value })?)
}
