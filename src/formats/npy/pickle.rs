//! The subset of Python's pickles that NumPy makes of an array of objects: lists, numbers, text, bytes and arrays.
//!
//! A pickle is a program, and may name any function to be called. Here a name is one of six that build arrays, which are built
//! by this file; every other is refused, as is every opcode that an array needs none of. Nothing is ever called.
//! Opcodes are those of <https://github.com/python/cpython/blob/main/Lib/pickletools.py>, protocols 2 to 5.
//!
//! Columns are given away as soon as they stand in the array's list, so that memory holds not much more than what a pickler
//! writes at once: a thousand of them.

use std::cell::Cell;
use std::collections::HashMap;
use std::io::BufRead;
use std::ops::RangeInclusive;
use std::rc::Rc;

use super::element::Element;
use super::flaw::{broken, forbidden};
use super::input::Input;
use super::value::{Name, Room, Value};
use super::{COLUMNS, Column};
use crate::formats::excerpt::shortened;
use crate::formats::source::Budget;
use crate::formats::{FormatError, FormatLimits};

/// Protocols that are read. Before 2 there were no opcodes for most of what is needed.
const PROTOCOLS: RangeInclusive<u8> = 2..=5;
/// Most values on the stack; picklers write lists a thousand entries at a time.
const MAX_STACK: usize = 1 << 13;
/// Most values that are remembered by number: some of the array, some of each column that is being read, and some of each
/// number in a list of `NumPy`'s numbers.
const MAX_MEMO: usize = 1 << 16;

/// Takes one column after another.
type Columns<'c> = dyn FnMut(Column) -> Result<(), FormatError> + 'c;

/// Reads the pickle of an array of `rows` events, and says how many columns there were.
pub(super) fn decode(
    reader: &mut dyn BufRead,
    rows: u64,
    budget: &Budget,
    limits: &FormatLimits,
    columns: &mut Columns<'_>,
) -> Result<u64, FormatError> {
    let mut machine = Machine {
        input: Input::new(reader),
        rows,
        budget,
        limits,
        columns,
        stack: Vec::new(),
        marks: Vec::new(),
        memo: HashMap::new(),
        memoized: 0,
        passing: Vec::new(),
        room: Room::new(limits.max_page_bytes),
        open: HashMap::new(),
        numbered: 0,
        outer: None,
        given: 0,
    };
    match machine.input.bytes()? {
        [0x80, protocol] if PROTOCOLS.contains(&protocol) => {}
        [0x80, protocol] => return Err(broken(&format!("protocol {protocol} is unknown"))),
        _ => return Err(broken("it does not begin with a protocol, 2 to 5")),
    }
    while machine.step()? {}
    match machine.stack.as_slice() {
        [Value::Whole] => Ok(machine.given),
        _ => Err(broken("it is not of an array of objects")),
    }
}

/// A list or an array while it is read.
#[derive(Default)]
struct Open {
    column: Column,
    /// Where it is remembered.
    memo: Option<u64>,
}

struct Machine<'m, 'c> {
    input: Input<'m>,
    /// Events that the header announces.
    rows: u64,
    budget: &'m Budget,
    limits: &'m FormatLimits,
    columns: &'m mut Columns<'c>,
    stack: Vec<Value>,
    /// Lengths of the stack where something was begun.
    marks: Vec<usize>,
    memo: HashMap<u64, Value>,
    /// How often something was remembered.
    memoized: u64,
    /// Numbers of what will not be needed any more when the next column begins.
    passing: Vec<u64>,
    room: Room,
    open: HashMap<u64, Open>,
    /// How many lists and arrays there were.
    numbered: u64,
    /// The list whose entries are columns.
    outer: Option<u64>,
    /// Columns given away.
    given: u64,
}

impl Machine<'_, '_> {
    /// Runs an opcode; whether there is more.
    fn step(&mut self) -> Result<bool, FormatError> {
        let start = self.input.at();
        let [opcode] = self.input.bytes()?;
        match opcode {
            b'.' => {
                self.input.end()?;
                return Ok(false);
            }
            0x95 => {
                let length = u64::from_le_bytes(self.input.bytes()?);
                self.input.begin_frame(length)?;
            }
            b'N' | 0x88 | 0x89 | b'G' | b'J' | b'K' | b'M' | 0x8a => self.plain(opcode)?,
            0x8c | b'X' | 0x8d | b'C' | b'U' | b'B' | b'T' | 0x8e | 0x96 => self.sized(opcode)?,
            0x94 | b'q' | b'r' | b'h' | b'j' => self.by_number(opcode)?,
            b'(' => self.mark()?,
            b']' => {
                let list = self.open()?;
                self.push(Value::Column(list))?;
            }
            b'a' => {
                let entry = self.pop()?;
                self.append(vec![entry])?;
            }
            b'e' => {
                let entries = self.since_mark()?;
                self.append(entries)?;
            }
            b')' => self.tuple(0)?,
            0x85..=0x87 => self.tuple(usize::from(opcode - 0x84))?,
            b't' => {
                let values = self.since_mark()?;
                let tuple = Value::tuple(values, &self.room)?;
                self.push(tuple)?;
            }
            b'c' => {
                let name = Name::parse(&self.input.line()?, &self.input.line()?)?;
                self.push(Value::Name(name))?;
            }
            0x93 => match (self.pop()?, self.pop()?) {
                (Value::Text(name), Value::Text(module)) => self.push(Value::Name(Name::parse(&module, &name)?))?,
                _ => return Err(broken("a name is not text")),
            },
            b'R' => self.reduce()?,
            b'b' => self.build()?,
            other => return Err(forbidden(&format!("has the opcode {other:#04x}"))),
        }
        self.input.end_within_frame(start)?;
        Ok(true)
    }

    /// Nothing, truths and numbers.
    fn plain(&mut self, opcode: u8) -> Result<(), FormatError> {
        let input = &mut self.input;
        let value = match opcode {
            b'N' => Value::None,
            0x88 | 0x89 => Value::Truth(opcode == 0x88),
            b'G' => Value::Number(f64::from_be_bytes(input.bytes()?)),
            b'J' => Value::Number(i32::from_le_bytes(input.bytes()?).into()),
            b'K' => Value::Number(u8::from_le_bytes(input.bytes()?).into()),
            b'M' => Value::Number(u16::from_le_bytes(input.bytes()?).into()),
            _ => {
                let [length] = input.bytes()?;
                let digits = input.take(length.into())?;
                Value::Number(whole(&digits).ok_or_else(|| broken("a number is beyond 64 bits"))? as f64)
            }
        };
        self.push(value)
    }

    /// Text and bytes, which say how long they are.
    fn sized(&mut self, opcode: u8) -> Result<(), FormatError> {
        let input = &mut self.input;
        let length = match opcode {
            0x8c | b'C' | b'U' => u64::from(u8::from_le_bytes(input.bytes()?)),
            b'X' | b'B' | b'T' => u64::from(u32::from_le_bytes(input.bytes()?)),
            _ => u64::from_le_bytes(input.bytes()?),
        };
        let most = self.limits.max_event_bytes;
        if length > most {
            let detail = format!("the pickle has a value of {length} bytes, longer than an event may be ({most})");
            return Err(FormatError::TooLarge { code: "event_too_large", detail });
        }
        let taken = input.take(length)?;
        let value = match opcode {
            0x8c | b'X' | 0x8d => Value::text(taken, &self.room)?,
            _ => Value::bytes(taken, &self.room)?,
        };
        self.push(value)
    }

    /// What remembers, and what recalls.
    fn by_number(&mut self, opcode: u8) -> Result<(), FormatError> {
        let number = match opcode {
            0x94 => self.memoized,
            b'q' | b'h' => u8::from_le_bytes(self.input.bytes()?).into(),
            _ => u32::from_le_bytes(self.input.bytes()?).into(),
        };
        if matches!(opcode, 0x94 | b'q' | b'r') {
            return self.remember(number);
        }
        let value = self.memo.get(&number).cloned();
        self.push(value.ok_or_else(|| forbidden("uses a list twice, or something that it never made"))?)
    }

    fn mark(&mut self) -> Result<(), FormatError> {
        if self.marks.len() == MAX_STACK {
            return Err(broken("more is begun than any pickler begins"));
        }
        self.marks.push(self.stack.len());
        Ok(())
    }

    fn push(&mut self, value: Value) -> Result<(), FormatError> {
        if self.stack.len() == MAX_STACK {
            return Err(broken("more lies on its stack than any pickler puts there"));
        }
        self.stack.push(value);
        Ok(())
    }

    fn pop(&mut self) -> Result<Value, FormatError> {
        if self.marks.last().is_some_and(|&mark| mark >= self.stack.len()) {
            return Err(broken("a mark stands where a value is needed"));
        }
        self.stack.pop().ok_or_else(|| broken("a value is missing"))
    }

    fn since_mark(&mut self) -> Result<Vec<Value>, FormatError> {
        let mark = self.marks.pop().ok_or_else(|| broken("a mark is missing"))?;
        Ok(self.stack.split_off(mark))
    }

    fn tuple(&mut self, length: usize) -> Result<(), FormatError> {
        let mut values = Vec::with_capacity(length);
        for _ in 0..length {
            values.push(self.pop()?);
        }
        values.reverse();
        let tuple = Value::tuple(values, &self.room)?;
        self.push(tuple)
    }

    fn remember(&mut self, number: u64) -> Result<(), FormatError> {
        let value = self.stack.last().ok_or_else(|| broken("there is nothing to remember"))?.clone();
        if self.memo.len() == MAX_MEMO {
            return Err(broken("it remembers more than an array needs"));
        }
        if let Value::Column(open) | Value::Array(open) = value
            && let Some(open) = self.open.get_mut(&open)
        {
            open.memo = Some(number);
        }
        let is_passing = value.is_passing();
        if self.memo.insert(number, value).is_none() && is_passing {
            self.passing.push(number);
        }
        self.memoized += 1;
        Ok(())
    }

    /// A new list or array.
    fn open(&mut self) -> Result<u64, FormatError> {
        for number in self.passing.drain(..) {
            self.memo.remove(&number);
        }
        if self.open.len() == MAX_STACK {
            return Err(broken("more lists are begun than any pickler begins at once"));
        }
        self.budget.next_event();
        self.numbered += 1;
        self.open.insert(self.numbered, Open::default());
        Ok(self.numbered)
    }

    /// Puts values into the list under them: numbers into a column, columns into the array's.
    fn append(&mut self, values: Vec<Value>) -> Result<(), FormatError> {
        let Some(&Value::Column(list)) = self.stack.last() else {
            return Err(broken("there is no list to append to"));
        };
        if self.marks.last().is_some_and(|&mark| mark >= self.stack.len()) {
            return Err(broken("a mark stands where a list is needed"));
        }
        for value in values {
            match value {
                Value::Number(number) if self.outer != Some(list) => self.grow(list, number)?,
                Value::Column(column) if column != list => {
                    self.be_outer(list)?;
                    self.give(column)?;
                }
                _ => return Err(forbidden("has a list that is not of numbers")),
            }
        }
        Ok(())
    }

    /// One number more of a column that is open.
    fn grow(&mut self, open: u64, number: f64) -> Result<(), FormatError> {
        let open = self.open.get_mut(&open).ok_or_else(|| broken("a list grows after it was used"))?;
        if open.column.push(number, self.limits.max_steps) {
            self.room.take(size_of::<f64>() as u64)?;
        }
        Ok(())
    }

    fn be_outer(&mut self, list: u64) -> Result<(), FormatError> {
        let open = self.open.get(&list).ok_or_else(|| broken("a list grows after it was used"))?;
        match self.outer {
            Some(outer) if outer == list => Ok(()),
            None if open.column.length == 0 => {
                self.outer = Some(list);
                Ok(())
            }
            _ => Err(forbidden("nests lists deeper than an array of columns does")),
        }
    }

    /// Gives a column away.
    fn give(&mut self, column: u64) -> Result<(), FormatError> {
        let open = self.open.remove(&column).ok_or_else(|| forbidden("uses a list twice"))?;
        if let Some(number) = open.memo {
            self.memo.remove(&number);
        }
        self.room.give_back(size_of_val(open.column.numbers.as_slice()) as u64);
        self.given += 1;
        if self.given > self.rows.saturating_mul(COLUMNS as u64) {
            return Err(broken("there are more columns than the array's shape has room for"));
        }
        (self.columns)(open.column)
    }

    /// Calls, in the sense of a pickle.
    fn reduce(&mut self) -> Result<(), FormatError> {
        let (Value::Tuple(arguments), Value::Name(name)) = (self.pop()?, self.pop()?) else {
            return Err(forbidden("calls what is no name"));
        };
        let made = match (name, arguments.as_slice()) {
            (Name::Reconstruct, [Value::Name(Name::Ndarray), Value::Tuple(_), Value::Bytes(_)]) => {
                Value::Array(self.open()?)
            }
            (Name::FromBuffer, [Value::Bytes(bytes), Value::Element(element), Value::Tuple(shape), Value::Text(_)]) => {
                let array = self.open()?;
                self.fill(array, shape, element.get(), bytes)?;
                Value::Column(array)
            }
            (
                Name::Dtype,
                [Value::Text(code), Value::Truth(_) | Value::Number(_), Value::Truth(_) | Value::Number(_)],
            ) => {
                let element =
                    Element::parse(code).ok_or_else(|| forbidden(&format!("has an array of {:?}", shortened(code))))?;
                Value::Element(Rc::new(Cell::new(element)))
            }
            (Name::Scalar, [Value::Element(element), Value::Bytes(bytes)]) => {
                let number = element.get().numbers(bytes, 1.0).and_then(|mut numbers| numbers.next());
                Value::Number(number.ok_or_else(|| broken("a number has other bytes than its type"))?)
            }
            (Name::Encode, [Value::Text(text), Value::Text(_)]) => {
                let latin = text.chars().map(|c| u8::try_from(u32::from(c)).ok()).collect::<Option<Vec<u8>>>();
                Value::bytes(latin.ok_or_else(|| broken("bytes are no Latin text"))?, &self.room)?
            }
            _ => return Err(forbidden(&format!("calls {name:?} with other arguments than NumPy does"))),
        };
        self.push(made)
    }

    /// Fills what was made.
    fn build(&mut self) -> Result<(), FormatError> {
        let (Value::Tuple(state), made) = (self.pop()?, self.pop()?) else {
            return Err(forbidden("has a state that is no tuple"));
        };
        let built = match (made, state.as_slice()) {
            // Of a type: order of bytes, and what only structures have.
            (
                Value::Element(element),
                [Value::Number(_), Value::Text(order), Value::None, Value::None, Value::None, ..],
            ) => {
                element.set(element.get().ordered(order.as_str() == ">"));
                Value::Element(element)
            }
            // Of an array: shape, type, whether in Fortran's order, content.
            (
                Value::Array(array),
                [Value::Number(_), Value::Tuple(shape), Value::Element(element), Value::Truth(false), content],
            ) => match content {
                Value::Column(list) if element.get() == Element::Object => self.close(array, *list, shape)?,
                Value::Bytes(bytes) => {
                    self.fill(array, shape, element.get(), bytes)?;
                    Value::Column(array)
                }
                _ => return Err(forbidden("has an array that is not of numbers")),
            },
            _ => return Err(forbidden("builds something else than an array in C's order")),
        };
        self.push(built)
    }

    /// The array of objects, whose list is read.
    fn close(&mut self, array: u64, list: u64, shape: &[Value]) -> Result<Value, FormatError> {
        let is_outer = match (self.outer, self.open.get(&list)) {
            (Some(outer), Some(_)) => outer == list,
            (None, Some(open)) => open.column.length == 0,
            (_, None) => false,
        };
        let is_whole = matches!(shape, [Value::Number(rows), Value::Number(4.0)] if *rows == self.rows as f64);
        if !is_outer || !is_whole {
            return Err(forbidden("has another array of objects than the header says, or several"));
        }
        self.outer = Some(list);
        self.open.remove(&list);
        self.open.remove(&array);
        Ok(Value::Whole)
    }

    /// Numbers of an array of one axis.
    fn fill(&mut self, array: u64, shape: &[Value], element: Element, bytes: &[u8]) -> Result<(), FormatError> {
        let &[Value::Number(length)] = shape else { return Err(forbidden("has a column of several axes")) };
        if self.open.get(&array).is_none_or(|open| open.column.length > 0) {
            return Err(broken("an array is filled twice"));
        }
        let numbers =
            element.numbers(bytes, length).ok_or_else(|| broken("an array has other bytes than its shape says"))?;
        for number in numbers {
            self.grow(array, number)?;
        }
        Ok(())
    }
}

/// A whole number, little-endian in two's complement.
fn whole(digits: &[u8]) -> Option<i64> {
    let sign = if digits.last().is_some_and(|last| last & 0x80 != 0) { 0xff } else { 0 };
    let mut wide = [sign; 8];
    wide.get_mut(..digits.len())?.copy_from_slice(digits);
    Some(i64::from_le_bytes(wide))
}
