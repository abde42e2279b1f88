//! Pointers as TUIO 1.1 bundles: the alive cursors, their positions, the number of the frame.
//!
//! Source: M. Kaltenbrunner, *TUIO 1.1 Protocol Specification*, tuio.org, profiles `/tuio/2Dcur` and `/tuio/2Dobj`. A bundle holds, in this order:
//!
//! | message | arguments |
//! |---|---|
//! | `source` | name@host |
//! | `alive` | the session numbers s of all cursors |
//! | `set` | s, x, y, X, Y, m: position as part of width and height from the top left corner, velocity in these parts a second, and how the speed changes [1/s²] |
//! | `set` of an object | s, i, x, y, a, X, Y, A, m, r: i is the class, here the user; angle a, its speed A and its acceleration r are 0 |
//! | `fseq` | number of the frame, ascending |
//!
//! A cursor is gone when its number is not alive any more, so that the next datagram repairs a lost one.

use rosc::{OscBundle, OscMessage, OscPacket, OscTime, OscType, encoder};

/// TUIO profiles.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Profile {
    /// Every pointer that is held down.
    Cursors,
    /// Pointers with a known user.
    Objects,
}

impl Profile {
    /// Address of all messages.
    fn address(self) -> &'static str {
        match self {
            Profile::Cursors => "/tuio/2Dcur",
            Profile::Objects => "/tuio/2Dobj",
        }
    }
}

/// Cursors in one datagram: a `set` takes 56 bytes (of an object 76), an identity 4; with the rest of it 20 of them stay below the 1472 bytes that fit into an Ethernet frame, for 64
/// cursors in all.
const MOST_SETS: usize = 18;
/// The same of objects.
const MOST_OBJECTS: usize = 12;
/// "Immediately" in OSC 1.0.
const AT_ONCE: OscTime = OscTime { seconds: 0, fractional: 1 };

/// One cursor.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Cursor {
    /// Its session number, new for each press.
    pub(super) session: i32,
    /// Its user, where known.
    pub(super) user: Option<u32>,
    /// Position as a share of width and height.
    pub(super) place: [f32; 2],
    /// [1/s]
    pub(super) velocity: [f32; 2],
    /// [1/s²]
    pub(super) acceleration: f32,
}

/// The datagrams of frame number `frame`: one, or several where one is too small. Each lists all alive cursors.
pub(super) fn datagrams(profile: Profile, source: &str, frame: i32, cursors: &[Cursor]) -> Vec<Vec<u8>> {
    // A frame without cursors is one datagram, too: it says that nobody is there.
    let most = if profile == Profile::Cursors { MOST_SETS } else { MOST_OBJECTS };
    let n = cursors.len().div_ceil(most).max(1);
    let parts = (0..n).map(|it| &cursors[it * most..cursors.len().min((it + 1) * most)]);
    let encoded = parts.map(|part| encoder::encode(&bundle(profile, source, frame, cursors, part)));
    // Writing into a vector fails never.
    encoded.filter_map(Result::ok).collect()
}

fn bundle(profile: Profile, source: &str, frame: i32, all: &[Cursor], part: &[Cursor]) -> OscPacket {
    let message = |args| OscPacket::Message(OscMessage { addr: profile.address().to_owned(), args });
    let word = |it: &str| OscType::String(it.to_owned());
    let alive = std::iter::once(word("alive")).chain(all.iter().map(|it| OscType::Int(it.session))).collect();
    let mut content = vec![message(vec![word("source"), word(source)]), message(alive)];
    for it in part {
        let [x, y] = it.place.map(OscType::Float);
        let [u, v] = it.velocity.map(OscType::Float);
        let (set, session, m) = (word("set"), OscType::Int(it.session), OscType::Float(it.acceleration));
        content.push(message(match profile {
            Profile::Cursors => vec![set, session, x, y, u, v, m],
            Profile::Objects => {
                let (class, none) = (OscType::Int(it.user.unwrap_or(0) as i32), OscType::Float(0.0));
                vec![set, session, class, x, y, none.clone(), u, v, none.clone(), m, none]
            }
        }));
    }
    content.push(message(vec![word("fseq"), OscType::Int(frame)]));
    OscPacket::Bundle(OscBundle { timetag: AT_ONCE, content })
}

#[cfg(test)]
mod tests {
    use rosc::decoder;

    use super::*;

    fn cursor(session: i32) -> Cursor {
        Cursor { session, user: None, place: [0.25, 0.5], velocity: [1.0, -2.0], acceleration: 0.5 }
    }

    /// By hand, from the OSC 1.0 specification: strings end in zeros to a multiple of four, numbers are big-endian.
    #[test]
    fn bytes_are_those_that_osc_and_tuio_have() {
        let mut expected = b"#bundle\0\0\0\0\0\0\0\0\x01".to_vec();
        let mut add = |tags: &[u8], rest: &[&[u8]]| {
            let mut body = b"/tuio/2Dcur\0".to_vec();
            body.extend_from_slice(tags);
            rest.iter().for_each(|it| body.extend_from_slice(it));
            expected.extend_from_slice(&(body.len() as u32).to_be_bytes());
            expected.extend_from_slice(&body);
        };
        add(b",ss\0", &[b"source\0\0", b"wall@host\0\0\0"]);
        add(b",si\0", &[b"alive\0\0\0", &[0, 0, 0, 9]]);
        add(
            b",sifffff\0\0\0\0",
            &[
                b"set\0",
                &[0, 0, 0, 9],
                &[0x3E, 0x80, 0, 0],
                &[0x3F, 0, 0, 0],
                &[0x3F, 0x80, 0, 0],
                &[0xC0, 0, 0, 0],
                &[0x3F, 0, 0, 0],
            ],
        );
        add(b",si\0", &[b"fseq\0\0\0\0", &[0, 0, 1, 2]]);
        assert_eq!(datagrams(Profile::Cursors, "wall@host", 258, &[cursor(9)]), [expected]);
    }

    #[test]
    fn object_has_its_user_as_class_and_a_crowd_of_them_fits() {
        let of = |session: i32| Cursor { user: Some(session as u32 + 3), ..cursor(session) };
        let [part] = &datagrams(Profile::Objects, "wall@host", 1, &[of(4)])[..] else { panic!("one datagram") };
        let (_, OscPacket::Bundle(bundle)) = decoder::decode_udp(part).unwrap() else { panic!("no bundle") };
        let OscPacket::Message(OscMessage { addr, args }) = &bundle.content[2] else { panic!("a bundle within") };
        assert_eq!(addr, "/tuio/2Dobj");
        // set s i x y a X Y A m r
        let numbers = [0.25, 0.5, 0.0, 1.0, -2.0, 0.0, 0.5, 0.0].map(OscType::Float);
        let expected = [OscType::String("set".to_owned()), OscType::Int(4), OscType::Int(7)].into_iter().chain(numbers);
        assert_eq!(*args, expected.collect::<Vec<_>>());
        let crowd: Vec<Cursor> = (0..64).map(of).collect();
        let parts = datagrams(Profile::Objects, "foveate@a-computer-with-a-long-name", 7, &crowd);
        assert!(parts.len() == 6 && parts.iter().all(|it| it.len() <= 1472), "{} parts", parts.len());
    }

    #[test]
    fn a_crowd_is_parted_into_datagrams_that_fit_each_with_all_that_are_alive() {
        let cursors: Vec<Cursor> = (0..64).map(cursor).collect();
        let parts = datagrams(Profile::Cursors, "foveate@a-computer-with-a-long-name", 7, &cursors);
        assert_eq!(parts.len(), 4);
        let mut seen = Vec::new();
        for part in &parts {
            assert!(part.len() <= 1472, "{} bytes", part.len());
            let (_, OscPacket::Bundle(bundle)) = decoder::decode_udp(part).unwrap() else { panic!("no bundle") };
            for packet in &bundle.content {
                let OscPacket::Message(OscMessage { args, .. }) = packet else { panic!("a bundle within") };
                match (&args[0], &args[1]) {
                    (OscType::String(word), OscType::Int(session)) if word == "set" => seen.push(*session),
                    (OscType::String(word), _) if word == "alive" => assert_eq!(args.len(), 65),
                    _ => {}
                }
            }
        }
        assert_eq!(seen, (0..64).collect::<Vec<_>>());
        assert_eq!(datagrams(Profile::Cursors, "a@b", 1, &[]).len(), 1, "no cursor is alive: that is sent");
    }
}
