//! Seeds that are `NumPy`'s arrays: of every kind that is read, lying headers, and pickles that would do something else.

use std::fs;
use std::path::Path;

/// What every one of them runs where it is run.
const COMMAND: &str = "touch headway-ran-this";

/// A header of version 1 before an array.
fn file(header: &str, array: &[u8]) -> Vec<u8> {
    versioned([1, 0], header, array)
}

fn versioned(version: [u8; 2], header: &str, array: &[u8]) -> Vec<u8> {
    let header = format!("{header:<117}\n");
    let length = header.len() as u32;
    let length = if version[0] == 1 { length.to_le_bytes()[..2].to_vec() } else { length.to_le_bytes().to_vec() };
    [b"\x93NUMPY", &version[..], &length, header.as_bytes(), array].concat()
}

fn objects(rows: u64) -> String {
    format!("{{'descr': '|O', 'fortran_order': False, 'shape': ({rows}, 4), }}")
}

/// Protocol 2 as far as the list of cells, which is on the stack.
fn opened(rows: u8) -> Vec<u8> {
    let mut bytes =
        b"\x80\x02cnumpy.core.multiarray\n_reconstruct\nq\0cnumpy\nndarray\nq\x01K\0\x85C\x01b\x87R(K\x01K".to_vec();
    bytes.extend([rows, b'K', 4, 0x86]);
    bytes.extend(
        b"cnumpy\ndtype\nX\x02\0\0\0O8\x89\x88\x87R(K\x03X\x01\0\0\0|NNNJ\xff\xff\xff\xffJ\xff\xff\xff\xffK?tb\x89]",
    );
    bytes
}

/// The end after [`opened`].
const CLOSED: &[u8] = b"tb.";

/// A column of these numbers as a list.
fn list(numbers: &[f64]) -> Vec<u8> {
    let mut bytes = b"](".to_vec();
    for number in numbers {
        bytes.push(b'G');
        bytes.extend(number.to_be_bytes());
    }
    bytes.push(b'e');
    bytes
}

fn event() -> Vec<u8> {
    let spacing: Vec<f64> = (0..4).map(|step| 20.0 + f64::from(step) / 8.0).collect();
    [list(&spacing), list(&[10.0; 4]), list(&[1.25; 4]), list(&[11.25; 4])].concat()
}

/// One event, with something before its cells, or after them.
fn whole(before: &[u8], after: &[u8]) -> Vec<u8> {
    file(&objects(1), &[&opened(1)[..], b"(", before, &event(), b"e", after, CLOSED].concat())
}

pub(super) fn good() -> Vec<(String, Vec<u8>)> {
    let golden = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden/npy");
    let mut files: Vec<_> = fs::read_dir(golden).unwrap().map(|entry| entry.unwrap().path()).collect();
    files.sort();
    let name = |path: &Path| path.file_stem().unwrap().to_str().unwrap().to_owned();
    let mut good: Vec<_> = files.iter().map(|path| (name(path), fs::read(path).unwrap())).collect();
    good.push(("least".to_owned(), whole(b"", b"")));
    good.push(("none".to_owned(), file(&objects(0), &[&opened(0)[..], CLOSED].concat())));
    let long = [list(&[9.0; 201]), list(&[9.0; 4]), list(&[9.0; 4]), list(&[9.0; 4])].concat();
    let bad = file(&objects(2), &[&opened(2)[..], b"(", &long, &event(), b"e", CLOSED].concat());
    good.push(("too-long-an-event".to_owned(), bad));
    good.push(("version-2".to_owned(), versioned([2, 0], &objects(1), &whole(b"", b"")[128..])));
    good
}

/// Headers that say something else than what follows, or nothing that is read.
pub(super) fn lies() -> Vec<(&'static str, Vec<u8>)> {
    let numbers: Vec<u8> = (0..16).flat_map(|_| 9.0_f64.to_le_bytes()).collect();
    let of = |header: &str| file(header, &numbers);
    let cut = whole(b"", b"");
    vec![
        ("empty", vec![]),
        ("magic", b"\x93NUMPX\x01\0".to_vec()),
        ("version-9", versioned([9, 0], &objects(1), &whole(b"", b"")[128..])),
        ("header-length", b"\x93NUMPY\x01\0\xff\xff{".to_vec()),
        ("header-length-4", b"\x93NUMPY\x02\0\xff\xff\xff\xff{".to_vec()),
        ("header-cut", cut[..60].to_vec()),
        ("header-shorter", [&cut[..8], &[60, 0], &cut[10..]].concat()),
        ("not-utf-8", [&cut[..20], &[0xff], &cut[21..]].concat()),
        ("no-dictionary", of("['<f8', False, (1, 4, 4)]")),
        ("descr-missing", of("{'fortran_order': False, 'shape': (1, 4, 4)}")),
        ("descr-twice", of("{'descr': '<f8', 'descr': '<f8', 'fortran_order': False, 'shape': (1, 4, 4)}")),
        ("key", of("{'descr': '<f8', 'fortran_order': False, 'shape': (1, 4, 4), 'eval': 1}")),
        ("expression", of("{'descr': '<f8', 'fortran_order': False, 'shape': (1, 2+2, 4)}")),
        ("call", of("{'descr': __import__('os').system('id'), 'fortran_order': False, 'shape': (1, 4, 4)}")),
        ("fortran", of("{'descr': '<f8', 'fortran_order': True, 'shape': (1, 4, 4)}")),
        ("negative", of("{'descr': '<f8', 'fortran_order': False, 'shape': (-1, 4, 4)}")),
        ("plus", of("{'descr': '<f8', 'fortran_order': False, 'shape': (+1, 4, 4)}")),
        ("huge", of("{'descr': '<f8', 'fortran_order': False, 'shape': (99999999999999999999999, 4, 4)}")),
        ("too-many", of("{'descr': '<f8', 'fortran_order': False, 'shape': (18446744073709551615, 4, 4)}")),
        ("too-long", of("{'descr': '<f8', 'fortran_order': False, 'shape': (1, 4, 18446744073709551615)}")),
        ("larger", of("{'descr': '<f8', 'fortran_order': False, 'shape': (2, 4, 4)}")),
        ("smaller", of("{'descr': '<f8', 'fortran_order': False, 'shape': (1, 4, 3)}")),
        ("no-steps", of("{'descr': '<f8', 'fortran_order': False, 'shape': (99, 4, 0)}")),
        ("columns", of("{'descr': '<f8', 'fortran_order': False, 'shape': (4, 1, 4)}")),
        ("axes", of("{'descr': '<f8', 'fortran_order': False, 'shape': (1, 4)}")),
        ("scalar", of("{'descr': '<f8', 'fortran_order': False, 'shape': ()}")),
        ("type", of("{'descr': '<c16', 'fortran_order': False, 'shape': (1, 4, 4)}")),
        ("text", of("{'descr': '<U8', 'fortran_order': False, 'shape': (1, 4, 4)}")),
        ("structure", of("{'descr': [('a', '|O'), ('b', '<f8')], 'fortran_order': False, 'shape': (1, 4)}")),
        ("subarray", of("{'descr': ('|O', (4,)), 'fortran_order': False, 'shape': (1,)}")),
        ("objects-3", of("{'descr': '|O', 'fortran_order': False, 'shape': (1, 4, 4)}")),
        ("objects-2", file(&objects(2), &whole(b"", b"")[128..])),
        ("objects-many", file(&objects(9_999_999), &whole(b"", b"")[128..])),
        ("behind", [&cut[..], b"."].concat()),
    ]
}

/// A pickle in the place of the array's.
fn alone(pickle: &[u8]) -> Vec<u8> {
    file(&objects(1), pickle)
}

/// Text as protocol 2 has it.
fn text(text: &str) -> Vec<u8> {
    [b"X", &(text.len() as u32).to_le_bytes()[..], text.as_bytes()].concat()
}

/// Pickles that would run something: alone, among an array's cells, or in an array's place.
pub(super) fn gadgets() -> Vec<(String, Vec<u8>)> {
    let command = text(COMMAND);
    let join = |parts: &[&[u8]]| parts.concat();
    let python = text(&format!("__import__('os').system('{COMMAND}')"));
    let system: &[u8] = b"cposix\nsystem\n";
    let named = |module: &str, name: &str| [text(module), text(name), b"\x93".to_vec()].concat();
    let calls: Vec<(&str, Vec<u8>)> = vec![
        ("global", join(&[system, &command, b"\x85R"])),
        ("global-os", join(&[b"cos\nsystem\n", &command, b"\x85R"])),
        ("global-nt", join(&[b"cnt\nsystem\n", &command, b"\x85R"])),
        ("stack-global", join(&[&named("os", "system"), &command, b"\x85R"])),
        ("inst", join(&[b"(", &command, b"ios\nsystem\n"])),
        ("obj", join(&[b"(", system, &command, b"o"])),
        ("newobj", join(&[&named("subprocess", "Popen"), &text("true"), b"\x85\x81"])),
        ("newobj-ex", join(&[&named("subprocess", "Popen"), &text("true"), b"\x85}\x92"])),
        ("eval", join(&[&named("builtins", "eval"), &python, b"\x85R"])),
        ("exec", join(&[b"c__builtin__\nexec\n", &python, b"\x85R"])),
        ("getattr", join(&[&named("builtins", "getattr"), &named("os", "path"), &text("os"), b"\x86R"])),
        ("import", join(&[&named("builtins", "__import__"), &text("os"), b"\x85R"])),
        ("attribute-of-numpy", join(&[&named("numpy", "os.system"), &command, b"\x85R"])),
        ("numpy-load", join(&[&named("numpy", "load"), &text("/etc/passwd"), b"\x85R"])),
        ("numpy-runstring", join(&[b"cnumpy.testing._private.utils\nrunstring\n", &python, b"}\x86R"])),
        ("numpy-fromfile", join(&[&named("numpy", "fromfile"), &text("/etc/passwd"), b"\x85R"])),
        ("multiarray-other", join(&[&named("numpy._core.multiarray", "fromfile"), &text("/etc/passwd"), b"\x85R"])),
        ("codecs-decode", join(&[&named("_codecs", "decode"), &text("x"), &text("zip"), b"\x86R"])),
        ("codecs-lookup", join(&[&named("_codecs", "lookup"), &text("hex"), b"\x85R"])),
        ("ext1", b"\x82\x01".to_vec()),
        ("ext2", b"\x83\x01\x01".to_vec()),
        ("ext4", b"\x84\x01\x01\x01\x01".to_vec()),
        ("persid", b"P1\n".to_vec()),
        ("binpersid", b"K\x01Q".to_vec()),
        (
            "build-setstate",
            join(&[b"cargparse\nNamespace\n)\x81}", &text("__setstate__"), system, b"sb", &command, b"b"]),
        ),
        ("build-dict", join(&[&named("numpy", "ndarray"), b"}", &text("__reduce__"), system, b"sb"])),
        ("copyreg", join(&[b"ccopy_reg\n_reconstructor\n", system, b"c__builtin__\nobject\nN\x87R"])),
        ("nested", join(&[&named("functools", "partial"), system, &command, b"\x86R)R"])),
        ("aliased", join(&[system, b"q\x55h\x55", &command, b"\x85R"])),
        ("map", join(&[&named("builtins", "map"), system, b"(", &command, b"l\x86R"])),
        ("function-type", join(&[&named("types", "FunctionType"), &named("types", "CodeType"), b")R}\x86R"])),
        ("pickle-loads", join(&[&named("pickle", "loads"), b"C\x01.\x85R"])),
        ("shutil", join(&[&named("shutil", "rmtree"), &text("headway-never"), b"\x85R"])),
        ("dictionary", join(&[b"}", &text("a"), b"K\x01s"])),
        ("set", b"\x8f(K\x01\x90".to_vec()),
        ("frozenset", b"(K\x01\x91".to_vec()),
        ("next-buffer", b"\x97".to_vec()),
        (
            "dtype-metadata",
            join(&[&named("numpy", "dtype"), &text("O8"), b"\x89\x88\x87R(K\x04", &text("<"), b"NNNK\0K\0K\0}tb"]),
        ),
        ("dtype-called", join(&[&named("numpy", "dtype"), system, b"\x89\x88\x87R"])),
        ("reconstruct-other", join(&[b"cnumpy.core.multiarray\n_reconstruct\n", system, b"K\0\x85C\x01b\x87R"])),
        ("text-called", join(&[&command, &command, b"\x85R"])),
    ];
    let mut gadgets = Vec::new();
    for (name, call) in calls {
        gadgets.push((format!("{name}-alone"), alone(&join(&[b"\x80\x04", &call, b"."]))));
        gadgets.push((format!("{name}-as-a-cell"), whole(&call, b"")));
    }
    gadgets
}

/// Pickles that would take all the memory, or all the time.
pub(super) fn bombs() -> Vec<(&'static str, Vec<u8>)> {
    [sizes(), mazes()].concat()
}

/// A pickle of protocol 4 in the place of the array's.
fn join(parts: &[&[u8]]) -> Vec<u8> {
    alone(&[b"\x80\x04", &parts.concat()[..]].concat())
}

fn sizes() -> Vec<(&'static str, Vec<u8>)> {
    let laughs: Vec<u8> = (0..60_u8).flat_map(|n| [b']', b'q', n + 1, b'(', b'h', n, b'h', n, b'e']).collect();
    let memos: Vec<u8> = (0..20_000_u32).flat_map(|n| [&b"r"[..], &n.to_le_bytes()].concat()).collect();
    let huge = u64::MAX.to_le_bytes();
    vec![
        ("long4", join(&[b"\x8b\xff\xff\xff\x7f\x01"])),
        ("long1", join(&[b"\x8a\xff", &[1; 255], b"."])),
        ("long1-cut", join(&[b"\x8a\xff\x01"])),
        ("binbytes8", join(&[b"\x8e", &huge, b"x"])),
        ("binbytes8-cut", join(&[b"\x8e\0\x10\0\0\0\0\0\0x"])),
        ("bytearray8", join(&[b"\x96", &huge, b"x"])),
        ("binunicode8", join(&[b"\x8d", &huge, b"x"])),
        ("binunicode-cut", join(&[b"X\0\x10\0\0x"])),
        ("frame", join(&[b"\x95", &huge, b"N."])),
        ("frame-longer", join(&[b"\x95\x05\0\0\0\0\0\0\0N."])),
        ("frame-shorter", join(&[b"\x95\x01\0\0\0\0\0\0\0K\x01."])),
        ("frame-in-a-frame", join(&[b"\x95\x20\0\0\0\0\0\0\0\x95\x02\0\0\0\0\0\0\0N."])),
        ("marks", join(&[&[b'('; 20_000]])),
        ("lists", join(&[&[b']'; 20_000]])),
        ("stack", join(&[&[b'N'; 20_000]])),
        ("deep-lists", join(&[&b"](".repeat(9000), &[b'e'; 9000], b"."])),
        ("deep-tuples", join(&[b")", &[0x85; 20_000], b"."])),
        ("wide-tuple", join(&[b"(", &[b'N'; 100], b"t."])),
        ("laughs", join(&[b"]q\0", &laughs, b"."])),
        ("laughing-tuples", join(&[b")q\0", &b"h\0h\0\x86q\0".repeat(60), b"."])),
        ("memos", join(&[b"N", &memos, b"."])),
        ("memo-far", join(&[b"Nr\xff\xff\xff\xffj\xff\xff\xff\xff."])),
        ("memo-missing", join(&[b"h\x07."])),
        ("memoize-nothing", join(&[b"\x94."])),
        ("texts", join(&[&[&b"X\0\x04\0\0"[..], &[b'x'; 1024]].concat().repeat(30)])),
        ("list-in-itself", join(&[b"]q\0h\0a."])),
    ]
}

fn mazes() -> Vec<(&'static str, Vec<u8>)> {
    let wide = [list(&[1.0; 4]), b"\x94".to_vec()].concat();
    vec![
        ("list-twice", whole(&[&list(&[1.0; 4])[..], b"q\x50h\x50"].concat(), b"")),
        ("list-of-text", whole(b"](X\x01\0\0\0xe", b"")),
        ("list-of-lists-of-lists", whole(b"]]]aa", b"")),
        ("array-twice", file(&objects(1), &[&opened(1)[..], b"(", &event(), b"etb0", &opened(1), b"(", &event(), b"etb."].concat())),
        ("array-longer", whole(&wide, b"")),
        ("array-shape", file(&objects(2), &[&opened(1)[..], b"(", &event(), &event(), b"e", CLOSED].concat())),
        ("fortran", {
            let mut opened = opened(1);
            let at = opened.len() - 2;
            opened[at] = 0x88;
            file(&objects(1), &[&opened[..], b"(", &event(), b"e", CLOSED].concat())
        }),
        ("text-no-utf-8", join(&[b"X\x01\0\0\0\xff."])),
        ("line-long", join(&[b"c", &[b'x'; 300], b"\n"])),
        ("line-cut", join(&[b"cnumpy"])),
        ("protocol-0", alone(b"cos\nsystem\n.")),
        ("protocol-1", alone(b"\x80\x01N.")),
        ("protocol-6", alone(b"\x80\x06N.")),
        ("protocol-twice", join(&[b"\x80\x04N."])),
        ("nothing", join(&[b"."])),
        ("unterminated", join(&[b"N"])),
        ("unterminated-array", { let whole = whole(b"", b""); whole[..whole.len() - 1].to_vec() }),
        ("unterminated-list", { let whole = whole(b"", b""); whole[..whole.len() - 20].to_vec() }),
        ("mark-missing", join(&[b"Ne."])),
        ("mark-in-the-way", join(&[b"](a."])),
        ("append-to-nothing", join(&[b"NNa."])),
        ("append-under-a-mark", join(&[b"](N(ee."])),
        ("appends-to-a-closed-list", file(&objects(1), &[&opened(1)[..], b"q\x60tb0h\x60(", &event(), b"e."].concat())),
        ("scalar-bytes", join(&[b"cnumpy.core.multiarray\nscalar\ncnumpy\ndtype\nX\x02\0\0\0f8\x89\x88\x87RC\x01x\x86R."])),
        ("encode", join(&[b"c_codecs\nencode\nX\x03\0\0\0\xe2\x82\xacX\x06\0\0\0latin1\x86R."])),
        ("array-bytes", whole(
            b"cnumpy.core.multiarray\n_reconstruct\ncnumpy\nndarray\nK\0\x85C\x01b\x87R(K\x01K\x03\x85cnumpy\ndtype\n\
              X\x02\0\0\0f8\x89\x88\x87R\x89C\x09xxxxxxxxxtb", b"")),
        ("array-of-text", whole(
            b"cnumpy.core.multiarray\n_reconstruct\ncnumpy\nndarray\nK\0\x85C\x01b\x87R(K\x01K\x03\x85cnumpy\ndtype\n\
              X\x02\0\0\0U8\x89\x88\x87R\x89C\x09xxxxxxxxxtb", b"")),
        ("array-of-axes", whole(
            b"cnumpy.core.multiarray\n_reconstruct\ncnumpy\nndarray\nK\0\x85C\x01b\x87R(K\x01K\x01K\x01\x86cnumpy\ndtype\n\
              X\x02\0\0\0f8\x89\x88\x87R\x89C\x08xxxxxxxxtb", b"")),
    ]
}
