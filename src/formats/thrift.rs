//! What a Parquet file says of itself, in Thrift's compact protocol, before the library reads it.
//!
//! The library reads a field by its number, whatever kind of value it is said to be, and passes over fields that it does not
//! know for as long as they say: a list of two thousand million truths is seven bytes, and takes it seconds. Here every field
//! of the format has the kind that the format gives it, so that both find the same fields, and no value takes more than its
//! bytes.

use std::io::{self, Read};

use super::FormatError;

/// Structures within structures; those of the format are seven deep.
const DEPTH: u32 = 16;

/// A value of the format.
#[derive(Debug, Clone, Copy)]
pub(super) enum Kind {
    Truth,
    Byte,
    Whole,
    Double,
    Bytes,
    List(&'static Kind),
    Struct(Shape),
}

/// Fields of a structure, by number; there may be others.
pub(super) type Shape = &'static [(i64, Kind)];

use Kind::{Byte, Bytes, Double, List, Struct, Truth, Whole};

const STATISTICS: Shape =
    &[(1, Bytes), (2, Bytes), (3, Whole), (4, Whole), (5, Bytes), (6, Bytes), (7, Truth), (8, Truth), (9, Whole)];
const TIME: Shape = &[(1, Truth), (2, Struct(UNIT))];
const UNIT: Shape = &[(1, Struct(&[])), (2, Struct(&[])), (3, Struct(&[]))];
const LOGICAL_TYPE: Shape = &[
    (1, Struct(&[])),
    (2, Struct(&[])),
    (3, Struct(&[])),
    (4, Struct(&[])),
    (5, Struct(&[(1, Whole), (2, Whole)])),
    (6, Struct(&[])),
    (7, Struct(TIME)),
    (8, Struct(TIME)),
    (10, Struct(&[(1, Byte), (2, Truth)])),
    (11, Struct(&[])),
    (12, Struct(&[])),
    (13, Struct(&[])),
    (14, Struct(&[])),
    (15, Struct(&[])),
    (16, Struct(&[(1, Byte)])),
    (17, Struct(&[(1, Bytes)])),
    (18, Struct(&[(1, Bytes), (2, Whole)])),
];
const SCHEMA_ELEMENT: Shape = &[
    (1, Whole),
    (2, Whole),
    (3, Whole),
    (4, Bytes),
    (5, Whole),
    (6, Whole),
    (7, Whole),
    (8, Whole),
    (9, Whole),
    (10, Struct(LOGICAL_TYPE)),
];
const KEY_VALUE: Shape = &[(1, Bytes), (2, Bytes)];
const BOX: Shape =
    &[(1, Double), (2, Double), (3, Double), (4, Double), (5, Double), (6, Double), (7, Double), (8, Double)];
const COLUMN: Shape = &[
    (1, Whole),
    (2, List(&Whole)),
    (3, List(&Bytes)),
    (4, Whole),
    (5, Whole),
    (6, Whole),
    (7, Whole),
    (8, List(&Struct(KEY_VALUE))),
    (9, Whole),
    (10, Whole),
    (11, Whole),
    (12, Struct(STATISTICS)),
    (13, List(&Struct(&[(1, Whole), (2, Whole), (3, Whole)]))),
    (14, Whole),
    (15, Whole),
    (16, Struct(&[(1, Whole), (2, List(&Whole)), (3, List(&Whole))])),
    (17, Struct(&[(1, Struct(BOX)), (2, List(&Whole))])),
];
const COLUMN_CHUNK: Shape = &[
    (1, Bytes),
    (2, Whole),
    (3, Struct(COLUMN)),
    (4, Whole),
    (5, Whole),
    (6, Whole),
    (7, Whole),
    (8, Struct(&[])),
    (9, Bytes),
];
const ROW_GROUP: Shape = &[
    (1, List(&Struct(COLUMN_CHUNK))),
    (2, Whole),
    (3, Whole),
    (4, List(&Struct(&[(1, Whole), (2, Truth), (3, Truth)]))),
    (5, Whole),
    (6, Whole),
    (7, Whole),
];
/// What a file says of itself at its end.
pub(super) const FILE: Shape = &[
    (1, Whole),
    (2, List(&Struct(SCHEMA_ELEMENT))),
    (3, Whole),
    (4, List(&Struct(ROW_GROUP))),
    (5, List(&Struct(KEY_VALUE))),
    (6, Bytes),
    (7, List(&Struct(UNIT))),
    (8, Struct(&[])),
    (9, Bytes),
];
/// What a page says of itself.
pub(super) const PAGE: Shape = &[
    (1, Whole),
    (2, Whole),
    (3, Whole),
    (4, Whole),
    (5, Struct(&[(1, Whole), (2, Whole), (3, Whole), (4, Whole), (5, Struct(STATISTICS))])),
    (6, Struct(&[])),
    (7, Struct(&[(1, Whole), (2, Whole), (3, Truth)])),
    (
        8,
        Struct(&[
            (1, Whole),
            (2, Whole),
            (3, Whole),
            (4, Whole),
            (5, Whole),
            (6, Whole),
            (7, Truth),
            (8, Struct(STATISTICS)),
        ]),
    ),
];

/// A structure in the compact protocol.
pub(super) struct Reader<R> {
    bytes: R,
    /// Bytes read so far.
    pub(super) read: u64,
}

impl<R: Read> Reader<R> {
    pub(super) fn new(bytes: R) -> Self {
        Self { bytes, read: 0 }
    }

    /// Reads a structure of this shape, and tells place and value of each whole number in it but for those in lists: field 4
    /// of the structure in field 8 is 804.
    ///
    /// # Errors
    /// When it ends too soon, or a field is of another kind than the format says.
    pub(super) fn walk(&mut self, shape: Shape, told: &mut dyn FnMut(i64, i64)) -> Result<(), FormatError> {
        self.structure(shape, 0, DEPTH, told)
    }

    fn structure(
        &mut self,
        shape: Shape,
        place: i64,
        depth: u32,
        told: &mut dyn FnMut(i64, i64),
    ) -> Result<(), FormatError> {
        let depth = depth.checked_sub(1).ok_or_else(malformed)?;
        let mut field = 0_i64;
        loop {
            let byte = self.byte()?;
            let wire = byte & 0x0f;
            if wire == 0 {
                return Ok(());
            }
            field = match byte >> 4 {
                0 => self.zigzag()?,
                further => field.checked_add(further.into()).ok_or_else(malformed)?,
            };
            match shape.iter().find(|(known, _)| *known == field) {
                Some((_, kind)) if !kind.is(wire) => return Err(malformed()),
                Some((_, Whole)) => told(100 * place + field, self.zigzag()?),
                Some((_, Struct(shape))) => self.structure(shape, 100 * place + field, depth, told)?,
                // Within a structure a truth is a kind of its own, without a value.
                Some((_, Truth)) => {}
                Some((_, kind)) => self.value(*kind, depth)?,
                None if matches!(wire, 1 | 2) => {}
                None => self.unknown(wire, depth)?,
            }
        }
    }

    fn value(&mut self, kind: Kind, depth: u32) -> Result<(), FormatError> {
        match kind {
            Truth | Byte => self.byte().map(drop),
            Whole => self.varint().map(drop),
            Double => self.pass(8),
            Bytes => {
                let length = self.varint()?;
                self.pass(length)
            }
            Struct(shape) => self.structure(shape, 0, depth, &mut |_, _| ()),
            List(kind) => {
                let (wire, count) = self.list()?;
                if count > 0 && !kind.is(wire) {
                    return Err(malformed());
                }
                // Each takes a byte at least, so that they end where the bytes do.
                (0..count).try_for_each(|_| self.value(*kind, depth))
            }
        }
    }

    /// Passes over a value that is not of the format, as far as the library does so in time: not over truths in lists, which
    /// it takes for nothing, nor over maps.
    fn unknown(&mut self, wire: u8, depth: u32) -> Result<(), FormatError> {
        let depth = depth.checked_sub(1).ok_or_else(malformed)?;
        match wire {
            3 => self.value(Byte, depth),
            4..=6 => self.value(Whole, depth),
            7 => self.value(Double, depth),
            8 => self.value(Bytes, depth),
            9 | 10 => {
                let (wire, count) = self.list()?;
                if count > 0 && matches!(wire, 1 | 2) {
                    return Err(malformed());
                }
                (0..count).try_for_each(|_| self.unknown(wire, depth))
            }
            12 => self.structure(&[], 0, depth, &mut |_, _| ()),
            _ => Err(malformed()),
        }
    }

    /// Kind and number of the elements that follow.
    fn list(&mut self) -> Result<(u8, u64), FormatError> {
        let byte = self.byte()?;
        let count = match byte >> 4 {
            15 => self.varint()?,
            few => few.into(),
        };
        Ok((byte & 0x0f, count))
    }

    fn pass(&mut self, length: u64) -> Result<(), FormatError> {
        let passed = io::copy(&mut (&mut self.bytes).take(length), &mut io::sink()).map_err(FormatError::Io)?;
        self.read += passed;
        if passed == length { Ok(()) } else { Err(malformed()) }
    }

    fn zigzag(&mut self) -> Result<i64, FormatError> {
        let value = self.varint()?;
        Ok((value >> 1).cast_signed() ^ -(value & 1).cast_signed())
    }

    fn varint(&mut self) -> Result<u64, FormatError> {
        let mut value = 0;
        for shift in (0..64).step_by(7) {
            let byte = self.byte()?;
            value |= u64::from(byte & 0x7f) << shift;
            if byte < 0x80 {
                return Ok(value);
            }
        }
        Err(malformed())
    }

    fn byte(&mut self) -> Result<u8, FormatError> {
        let mut byte = [0];
        self.bytes.read_exact(&mut byte).map_err(|_| malformed())?;
        self.read += 1;
        Ok(byte[0])
    }
}

impl Kind {
    /// Whether the protocol's kind `wire` holds such a value.
    fn is(self, wire: u8) -> bool {
        match self {
            Truth => matches!(wire, 1 | 2),
            Byte => wire == 3,
            Whole => matches!(wire, 4..=6),
            Double => wire == 7,
            Bytes => wire == 8,
            List(_) => wire == 9,
            Struct(_) => wire == 12,
        }
    }
}

fn malformed() -> FormatError {
    FormatError::malformed(None, &"what the file says of itself cannot be read")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(shape: Shape, bytes: &[u8]) -> Result<Vec<(i64, i64)>, FormatError> {
        let mut told = Vec::new();
        let mut reader = Reader::new(bytes);
        reader.walk(shape, &mut |field, value| told.push((field, value)))?;
        assert_eq!(reader.read, bytes.len() as u64);
        Ok(told)
    }

    #[test]
    fn own_numbers_are_told_and_other_values_passed_over() {
        let page =
            [0x15, 6, 0x15, 20, 0x15, 22, 0x2c, 0x15, 2, 0x15, 0, 0x15, 6, 0x15, 6, 0x1c, 0x18, 1, b'x', 0, 0, 0];
        assert_eq!(read(PAGE, &page).unwrap(), [(1, 3), (2, 10), (3, 11), (501, 1), (502, 0), (503, 3), (504, 3)]);
        // What is not of the format: truths, bytes, numbers, lists and structures.
        let other =
            [0xf1, 0x13, 9, 0x17, 1, 2, 3, 4, 5, 6, 7, 8, 0x19, 0x25, 2, 0x84, 1, 0x1c, 0x12, 0x18, 0, 0, 0x1a, 0, 0];
        assert_eq!(read(PAGE, &other).unwrap(), []);
    }

    #[test]
    fn what_costs_more_than_its_bytes_or_is_of_another_kind_is_refused() {
        for (what, bytes) in [
            ("truths without end", &[0xf9, 0xf1, 0xff, 0xff, 0xff, 0xff, 7, 0][..]),
            ("truths in lists in a list", &[0xf9, 0x29, 0x21, 0x21, 0]),
            ("a map", &[0xfb, 0xff, 0xff, 0xff, 0xff, 7, 0x11, 0]),
            ("numbers that are not there", &[0xf9, 0xf5, 0xff, 0xff, 0xff, 0xff, 7, 0]),
            ("a size that is a text, and hides another", &[0x28, 4, 0x15, 2, 0x15, 2, 0]),
            ("a list of other elements", &[0x29, 0x18, 1, b'x', 0]),
            ("a number without end", &[0x15, 255, 255, 255, 255, 255, 255, 255, 255, 255, 255, 1, 0]),
            ("nothing", &[]),
        ] {
            assert!(read(FILE, bytes).is_err(), "{what}");
        }
        let deep = [[0xfc; 40], [0; 40]].concat();
        assert!(read(FILE, &deep).is_err());
    }
}
