//! A safetensors file: its header, believed only as far as it fits the bytes, and its tensors.

use std::collections::{BTreeSet, HashMap, HashSet};
use std::fmt;

use safetensors::{Dtype, SafeTensors};
use serde::de::{Deserializer, Error, IgnoredAny, MapAccess, Visitor};
use serde::{Deserialize, de::DeserializeSeed};

use super::defect::{ArtifactError, Defect};
use crate::artifact::layers::{SECOND_BIAS, layers};
use crate::formats::excerpt;
use crate::lstm::Layout;

/// Longest header, bytes: that of a version with several thousand regimes. The library reads ones of 100 MB.
pub(super) const MAX_HEADER_BYTES: u64 = 4 << 20;

/// What lies in a file, where it lies.
pub(super) struct File<'a> {
    tensors: SafeTensors<'a>,
    pub(super) metadata: HashMap<String, String>,
}

impl<'a> File<'a> {
    /// Reads the header and checks it against the bytes.
    pub(super) fn parse(bytes: &'a [u8]) -> Result<Self, ArtifactError> {
        let malformed = |detail: String| ArtifactError::Malformed(format!("not a safetensors file: {detail}"));
        let (length, rest) =
            bytes.split_first_chunk::<8>().ok_or_else(|| malformed("it is shorter than 8 bytes".to_owned()))?;
        let length = u64::from_le_bytes(*length);
        if length > MAX_HEADER_BYTES {
            return Err(malformed(format!("its header would have {length} bytes, more than {MAX_HEADER_BYTES}")));
        }
        let header = usize::try_from(length).ok().and_then(|length| rest.get(..length));
        let header = header.ok_or_else(|| malformed(format!("it ends within its header of {length} bytes")))?;
        serde_json::from_slice::<OnceEach>(header).map_err(|e| malformed(format!("its header: {}", excerpt(&e))))?;
        let (_, read) = SafeTensors::read_metadata(bytes).map_err(|e| malformed(excerpt(&e)))?;
        let tensors = SafeTensors::deserialize(bytes).map_err(|e| malformed(excerpt(&e)))?;
        Ok(Self { tensors, metadata: read.metadata().clone().unwrap_or_default() })
    }

    /// The values of a tensor that must be there, of this shape, finite f32.
    pub(super) fn floats(&self, name: &str, shape: &[usize]) -> Result<Vec<f32>, Defect> {
        let missing = || Defect::tensor(name, "missing", format!("the file has no tensor {name}"));
        let tensor = self.tensors.tensor(name).map_err(|_| missing())?;
        if tensor.shape() != shape {
            let detail = format!("{name} has the shape {}, not {shape:?}", excerpt(&format!("{:?}", tensor.shape())));
            return Err(Defect::tensor(name, "wrong_shape", detail));
        }
        if tensor.dtype() != Dtype::F32 {
            let detail = format!("{name} is {:?}; only F32 is taken (in torch: module.float())", tensor.dtype());
            return Err(Defect::tensor(name, "wrong_type", detail));
        }
        let values: Vec<f32> = tensor.data().as_chunks::<4>().0.iter().map(|x| f32::from_le_bytes(*x)).collect();
        if !values.iter().all(|x| x.is_finite()) {
            return Err(Defect::tensor(name, "not_finite", format!("{name} holds NaN or an infinity")));
        }
        Ok(values)
    }

    /// The tensors of a network behind a prefix of their names, as one flat vector.
    pub(super) fn flat(&self, prefix: &str, layout: Layout) -> Result<Vec<f32>, Defect> {
        let parts = layers(layout).map(|layer| self.floats(&format!("{prefix}{}", layer.name), &layer.shape));
        Ok(parts.into_iter().collect::<Result<Vec<_>, _>>()?.concat())
    }

    /// The weights of a network; torch's two biases are added up.
    pub(super) fn weights(&self, layout: Layout) -> Result<Vec<f32>, Defect> {
        let mut weights = self.flat("", layout)?;
        let second = self.floats(SECOND_BIAS, &[layout.gates()])?;
        for (bias, second) in weights[layout.bias()].iter_mut().zip(second) {
            // −0 stays what it is.
            if second != 0.0 {
                *bias += second;
            }
        }
        match weights.iter().position(|x| !x.is_finite()) {
            None => Ok(weights),
            Some(_) => Err(Defect::tensor(SECOND_BIAS, "not_finite", "the biases add up to an infinity".to_owned())),
        }
    }

    /// Refuses a file with tensors of other names.
    pub(super) fn refuse_others(&self, known: &HashSet<String>) -> Result<(), Defect> {
        let other = self.tensors.names().into_iter().filter(|name| !known.contains(*name)).collect::<BTreeSet<_>>();
        let Some(first) = other.first() else { return Ok(()) };
        let shown = excerpt(first);
        Err(Defect::tensor(&shown, "unknown_tensor", format!("{shown} is no tensor that is known here")))
    }
}

/// The names of the tensors of a network alone.
pub(super) fn network_names(layout: Layout) -> HashSet<String> {
    layers(layout).into_iter().map(|layer| layer.name).chain([SECOND_BIAS]).map(str::to_owned).collect()
}

/// A header in which nothing is said twice: what is said last would win.
struct OnceEach;

impl<'de> Deserialize<'de> for OnceEach {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        Names { inner: true }.deserialize(deserializer).map(|()| Self)
    }
}

/// Members of an object; those of its `__metadata__` too where it may have `inner` ones.
struct Names {
    inner: bool,
}

impl<'de> DeserializeSeed<'de> for Names {
    type Value = ();

    fn deserialize<D: Deserializer<'de>>(self, deserializer: D) -> Result<(), D::Error> {
        deserializer.deserialize_map(self)
    }
}

impl<'de> Visitor<'de> for Names {
    type Value = ();

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("an object")
    }

    fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<(), A::Error> {
        let mut seen = HashSet::new();
        while let Some(name) = map.next_key::<String>()? {
            if self.inner && name == "__metadata__" {
                map.next_value_seed(Self { inner: false })?;
            } else {
                map.next_value::<IgnoredAny>()?;
            }
            if !seen.insert(name.clone()) {
                return Err(A::Error::custom(format!("{} is there twice", excerpt(&name))));
            }
        }
        Ok(())
    }
}
