//! Our packets against 281 byte strings of another implementation of VISCA.
//!
//! Of 223 of a controller we write 36 byte by byte and read them back: motors, limits, zoom, focus, power, inquiries. The others must be
//! taken for none of ours: exposure, colour, gain, presets, menus, focus by speed, raw bytes. Of 58 of a head all are framed and found
//! apart as acknowledgement, completion, refusal or answer; 30 are read to what they mean, the other answers are to inquiries that we never make.

use std::collections::BTreeSet;

use foveate_pan_tilt::visca::{
    Address, Answer, Command, Corner, Format, Framer, Inquiry, Packet, PanDrive, Refusal, Reply, Request, Speed,
    TiltDrive, ZoomDrive,
};

/// Every distinct byte string of the recording.
fn vectors() -> Option<BTreeSet<Vec<u8>>> {
    let folder = foveate_testkit::data_dir_or_skip("vectors", "s21_visca_vectors")?;
    let text = std::fs::read_to_string(folder.join("vectors.tsv")).unwrap();
    let lines = text.lines().filter(|line| !line.starts_with('#'));
    let bytes = |line: &str| {
        let hex = line.split('\t').next().unwrap().split(' ');
        hex.map(|byte| u8::from_str_radix(byte, 16).unwrap()).collect()
    };
    Some(lines.map(bytes).collect())
}

fn drive(pan: PanDrive, tilt: TiltDrive, pan_speed: u8, tilt_speed: u8) -> Request {
    Request::Command(Command::Drive { pan, tilt, speed: Speed { pan: pan_speed, tilt: tilt_speed } })
}

/// What the vectors of the controller's side that are ours should say.
fn requests() -> Vec<Request> {
    let command = Request::Command;
    let mut list = vec![
        command(Command::Home),
        command(Command::Reset),
        command(Command::Absolute { pan: -1, tilt: -1, speed: Speed { pan: 24, tilt: 24 } }),
        drive(PanDrive::Stop, TiltDrive::Up, 14, 14),
        drive(PanDrive::Stop, TiltDrive::Down, 14, 14),
        drive(PanDrive::Left, TiltDrive::Stop, 14, 14),
        drive(PanDrive::Right, TiltDrive::Stop, 14, 14),
        drive(PanDrive::Stop, TiltDrive::Stop, 5, 5),
        drive(PanDrive::Stop, TiltDrive::Stop, 0, 0),
        drive(PanDrive::Stop, TiltDrive::Up, 24, 20),
        drive(PanDrive::Stop, TiltDrive::Down, 24, 24),
        drive(PanDrive::Left, TiltDrive::Stop, 24, 24),
        drive(PanDrive::Right, TiltDrive::Stop, 24, 24),
        command(Command::LimitSet { corner: Corner::DownLeft, pan: 0x0123, tilt: 0x0456 }),
        command(Command::Zoom(ZoomDrive::Stop)),
        command(Command::Zoom(ZoomDrive::Tele(None))),
        command(Command::Zoom(ZoomDrive::Wide(None))),
        command(Command::Zoom(ZoomDrive::Tele(Some(5)))),
        command(Command::Zoom(ZoomDrive::Wide(Some(5)))),
        command(Command::FocusAuto(true)),
        command(Command::FocusAuto(false)),
        command(Command::FocusDirect(0x1234)),
        command(Command::FocusDirect(0xF000)),
        command(Command::LimitClear { corner: Corner::DownLeft }),
        command(Command::Power(true)),
        command(Command::Power(false)),
        Request::Inquiry(Inquiry::Power),
        Request::Inquiry(Inquiry::Zoom),
        Request::Inquiry(Inquiry::Version),
        Request::Inquiry(Inquiry::PanTiltPosition),
    ];
    list.extend([0, 0x2000, 0x4000, 0x7000, 0x7AC0, 0x7FFF].map(|it| command(Command::ZoomDirect(it))));
    list
}

#[test]
fn requests_are_written_as_the_other_writes_them_and_read_back() {
    let Some(vectors) = vectors() else { return };
    let mut ours = BTreeSet::new();
    for request in requests() {
        // The other sends a stop without a speed, which our driver never does.
        let packet = request.encode(Address::FIRST, Format::EVI).unwrap();
        assert!(vectors.contains(packet.bytes()), "{request:?} is {packet:?}, which the other does not know");
        assert_eq!(Request::decode(&packet, Format::EVI), Some(request));
        ours.insert(packet.bytes().to_vec());
    }
    // And no other vector is taken for one of ours: presets, menus, exposure, colour and what else heads are told.
    for bytes in vectors.iter().filter(|it| it[0] == 0x81) {
        let read = Packet::from_bytes(bytes).and_then(|it| Request::decode(&it, Format::EVI));
        assert_eq!(read.is_some(), ours.contains(bytes), "{bytes:02X?} is read as {read:?}");
    }
    assert_eq!(ours.len(), 36);
}

/// What the vectors of the head's side should say, and of which inquiry where they answer one.
fn replies() -> Vec<(&'static [u8], Reply)> {
    let refused = |socket, refusal| Reply::Refused { socket, refusal };
    vec![
        (&[0x90, 0x60, 0x02, 0xFF], refused(0, Refusal::Syntax)),
        (&[0x90, 0x60, 0x03, 0xFF], refused(0, Refusal::BufferFull)),
        (&[0x90, 0x61, 0x41, 0xFF], refused(1, Refusal::NotExecutable)),
        (&[0x90, 0x61, 0x03, 0xFF], refused(1, Refusal::BufferFull)),
        (&[0x90, 0x60, 0x41, 0xFF], refused(0, Refusal::NotExecutable)),
        (&[0x90, 0x60, 0x05, 0xFF], refused(0, Refusal::NoSocket)),
        (&[0x90, 0x61, 0x04, 0xFF], refused(1, Refusal::Cancelled)),
        (&[0x90, 0x61, 0x05, 0xFF], refused(1, Refusal::NoSocket)),
        (&[0x90, 0x62, 0x05, 0xFF], refused(2, Refusal::NoSocket)),
        (&[0x90, 0x60, 0x01, 0xFF], refused(0, Refusal::Length)),
        (&[0x90, 0x60, 0x04, 0xFF], refused(0, Refusal::Cancelled)),
        (&[0x90, 0x60, 0x00, 0xFF], refused(0, Refusal::Other(0))),
        (&[0x90, 0x62, 0x04, 0xFF], refused(2, Refusal::Cancelled)),
        (&[0x90, 0x62, 0x02, 0xFF], refused(2, Refusal::Syntax)),
    ]
}

/// Answers: bytes behind `90 50`, the inquiry, what it should say.
fn answers() -> Vec<(&'static [u8], Inquiry, Answer)> {
    let position = |pan, tilt| Answer::Position { pan, tilt };
    vec![
        (&[0x02], Inquiry::Power, Answer::Power(true)),
        (&[0x03], Inquiry::Power, Answer::Power(false)),
        (&[0x02], Inquiry::FocusMode, Answer::FocusAuto(true)),
        (&[0x03], Inquiry::FocusMode, Answer::FocusAuto(false)),
        (&[1, 2, 3, 4, 5, 6, 7, 8], Inquiry::PanTiltPosition, position(0x1234, 0x5678)),
        (&[0, 1, 2, 3, 0, 4, 5, 6], Inquiry::PanTiltPosition, position(0x0123, 0x0456)),
        (&[1, 0, 0, 0, 15, 0, 0, 0], Inquiry::PanTiltPosition, position(4096, -4096)),
        (&[8, 0, 0, 0, 8, 0, 0, 0], Inquiry::PanTiltPosition, position(-32_768, -32_768)),
        (&[15, 15, 15, 15, 15, 15, 14, 13], Inquiry::PanTiltPosition, position(-1, -19)),
        (&[0, 0, 0, 0, 0, 0, 0, 0], Inquiry::PanTiltPosition, position(0, 0)),
        (&[10, 11, 12, 13], Inquiry::Zoom, Answer::Zoom(0xABCD)),
        (&[15, 15, 15, 15], Inquiry::Zoom, Answer::Zoom(0xFFFF)),
        (&[0, 0, 0, 0], Inquiry::Zoom, Answer::Zoom(0)),
        (&[1, 2, 3, 4], Inquiry::Focus, Answer::Focus(0x1234)),
        (&[5, 6, 7, 8], Inquiry::Focus, Answer::Focus(0x5678)),
        (&[0, 1, 2, 3], Inquiry::Focus, Answer::Focus(0x0123)),
        (&[0x02, 0x03], Inquiry::PanTiltMaxSpeed, Answer::MaxSpeed(Speed { pan: 2, tilt: 3 })),
        (&[0x12, 0x34], Inquiry::PanTiltStatus, Answer::Status(0x1234)),
    ]
}

#[test]
fn replies_are_read_as_the_other_means_them() {
    let Some(vectors) = vectors() else { return };
    let mut ours = BTreeSet::new();
    for (bytes, expected) in replies() {
        assert!(vectors.contains(bytes), "{bytes:02X?}");
        assert_eq!(Reply::decode(&Packet::from_bytes(bytes).unwrap(), 1), Some(expected), "{bytes:02X?}");
        ours.insert(bytes.to_vec());
    }
    for (answer, inquiry, expected) in answers() {
        let bytes = [&[0x90, 0x50], answer, &[0xFF]].concat();
        assert!(vectors.contains(&bytes), "{bytes:02X?}");
        let Some(Reply::Answer(packet)) = Reply::decode(&Packet::from_bytes(&bytes).unwrap(), 1) else {
            panic!("{bytes:02X?} is no answer")
        };
        assert_eq!(inquiry.read(&packet, Format::EVI), Some(expected), "{bytes:02X?}");
        ours.insert(bytes);
    }
    assert_eq!(ours.len(), 30);
}

#[test]
fn every_vector_of_the_head_is_framed_and_none_is_taken_for_another_heads() {
    let Some(vectors) = vectors() else { return };
    let of_heads: Vec<_> = vectors.iter().filter(|it| it[0] == 0x90).collect();
    let mut n_answers = 0;
    for bytes in &of_heads {
        let mut framer = Framer::default();
        let packets: Vec<Packet> = bytes.iter().filter_map(|&byte| framer.push(byte)).collect();
        let [packet] = packets[..] else { panic!("{bytes:02X?} gives {packets:?}") };
        let reply = Reply::decode(&packet, 1).unwrap();
        assert_eq!(Reply::decode(&packet, 2), None);
        if bytes[2..bytes.len() - 1].contains(&0xFF) {
            // The terminator cannot be in an answer: what stands before the first one is the packet.
            assert_eq!((reply, framer.discarded()), (Reply::Completed { socket: 0 }, 3), "{bytes:02X?}");
        } else {
            assert_eq!((packet.bytes(), framer.discarded()), (&bytes[..], 0));
            n_answers += usize::from(matches!(reply, Reply::Answer(_)));
        }
    }
    assert_eq!((vectors.len(), of_heads.len(), n_answers), (281, 58, 43));
}
