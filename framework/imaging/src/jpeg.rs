//! Whether a JPEG is whole.
//!
//! Decoders make gray of what was cut off, with no complaint. The structure tells (ITU T.81, annex B): segments with a length, then entropy-coded data in which 0xFF is
//! always followed by 0x00 or a restart marker, and an end marker. Damage that leaves this structure intact is not noticed: JPEG has no check sums.

/// Checks that a JPEG is complete by walking its segments to the end marker.
///
/// # Errors
/// A sentence about what was found instead, to be put after the name of a file.
pub fn check_whole(bytes: &[u8]) -> Result<(), String> {
    let cut_off = || format!("is a truncated JPEG: {} bytes, and no end marker", bytes.len());
    let mut at = 2;
    let mut in_scan = false;
    loop {
        let Some(offset) = bytes.get(at..).and_then(|rest| rest.iter().position(|&it| it == 0xff)) else {
            return Err(cut_off());
        };
        if !in_scan && offset > 0 {
            return Err(format!("is a broken JPEG: no marker at byte {at}"));
        }
        at += offset;
        match bytes.get(at + 1) {
            None => return Err(cut_off()),
            Some(0xff) => at += 1,
            Some(0x00 | 0x01 | 0xd0..=0xd7) => at += 2,
            Some(0xd9) => return Ok(()),
            Some(&marker) => {
                let Some(&[high, low]) = bytes.get(at + 2..at + 4) else { return Err(cut_off()) };
                at += 2 + usize::from(u16::from_be_bytes([high, low]));
                in_scan = marker == 0xda;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A start, one segment, a scan with a stuffed 0xFF and a restart marker, the end.
    const WHOLE: [u8; 22] =
        [0xff, 0xd8, 0xff, 0xe0, 0, 4, 0xff, 0xd9, 0xff, 0xda, 0, 2, 7, 0xff, 0x00, 9, 0xff, 0xd3, 1, 2, 0xff, 0xd9];

    #[test]
    fn an_end_marker_counts_where_it_stands_by_itself() {
        assert_eq!(check_whole(&WHOLE), Ok(()));
        for length in 2..WHOLE.len() {
            let fault = check_whole(&WHOLE[..length]).unwrap_err();
            assert!(fault.contains(&format!("truncated JPEG: {length} bytes")), "{length}: {fault}");
        }
        assert!(check_whole(&[0xff, 0xd8, 1, 2, 0xff, 0xd9]).unwrap_err().contains("no marker at byte 2"));
    }
}
