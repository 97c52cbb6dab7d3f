//! NumPy arrays as arguments and as results.
//!
//! Input arrays are checked for dtype, shape and layout. Result arrays are written in place: into the caller's array, or
//! into a recycled one of [`ArrayRecycler`].

use std::fmt::Display;

use numpy::{
    Element, IxDyn, PyArray1, PyArrayDescrMethods, PyArrayDyn, PyArrayMethods, PyReadwriteArrayDyn,
    PyUntypedArray, PyUntypedArrayMethods,
};
use pyo3::prelude::*;

use crate::errors::{invalid, rejected};

/// Copies an array of numbers with this shape into `target`, as f32.
///
/// # Errors
/// `ValueError` if `value` is not an array of numbers with this shape.
pub(crate) fn copy_f32(
    field: &str,
    value: &Bound<'_, PyAny>,
    shape: &[usize],
    target: &mut Vec<f32>,
) -> PyResult<()> {
    target.clear();
    if let Ok(array) = value.cast::<PyArrayDyn<f32>>()
        && array.shape() == shape
        && let Ok(read) = array.try_readonly()
        && let Ok(values) = read.as_slice()
    {
        target.extend_from_slice(values);
        return Ok(());
    }
    let array = numeric_array(field, value, shape, "fiu")?;
    let array = contiguous::<f32>(field, &array)?;
    let read = array.try_readonly().map_err(|error| rejected(field, error))?;
    target.extend_from_slice(read.as_slice().map_err(|error| rejected(field, error))?);
    Ok(())
}

/// Reads an array of integers with this shape.
///
/// # Errors
/// `ValueError` if `value` is not an array of integers with this shape.
pub(crate) fn read_i64(field: &str, value: &Bound<'_, PyAny>, shape: &[usize]) -> PyResult<Vec<i64>> {
    let array = contiguous::<i64>(field, &numeric_array(field, value, shape, "iu")?)?;
    array.to_vec().map_err(|error| rejected(field, error))
}

/// Numbers of an array whose first axis has any length.
pub(crate) struct NumericRows {
    /// All values in C order.
    pub(crate) values: Vec<f64>,
    /// Length of the first axis.
    pub(crate) len: usize,
    /// True if the array holds floats of at most 32 bits.
    pub(crate) is_single_precision: bool,
}

/// Reads an array whose first axis has any length and whose other axes have the lengths `inner`.
///
/// # Errors
/// `ValueError` if `value` is not such an array of numbers.
pub(crate) fn read_f64(field: &str, value: &Bound<'_, PyAny>, inner: &[usize]) -> PyResult<NumericRows> {
    let numpy = value.py().import("numpy")?;
    let array = numpy.call_method1("asarray", (value,)).map_err(|_| not_numeric(field, value))?;
    let array = array.cast::<PyUntypedArray>().map_err(|_| not_numeric(field, value))?;
    let len = array.shape().first().copied().unwrap_or(0);
    let shape: Vec<usize> = std::iter::once(len).chain(inner.iter().copied()).collect();
    let is_single_precision =
        array.dtype().itemsize() <= size_of::<f32>() && char::from(array.dtype().kind()) == 'f';
    let array = contiguous::<f64>(field, &numeric_array(field, array, &shape, "fiu")?)?;
    let values = array.to_vec().map_err(|error| rejected(field, error))?;
    Ok(NumericRows { values, len, is_single_precision })
}

/// Reads a NumPy array of `len` bools.
///
/// # Errors
/// `ValueError` if `value` is something else.
pub(crate) fn read_mask(field: &str, value: &Bound<'_, PyAny>, len: usize) -> PyResult<Vec<bool>> {
    let error = || invalid(field, format!("a NumPy array of {len} bools"), describe(value));
    let mask = value.cast::<PyArray1<bool>>().map_err(|_| error())?;
    let mask: Vec<bool> = mask.try_readonly().map_err(|error| rejected(field, error))?.as_array().to_vec();
    if mask.len() == len { Ok(mask) } else { Err(error()) }
}

/// Borrows a caller's array for writing.
///
/// # Errors
/// `ValueError` unless the array has exactly this dtype and shape, is C-contiguous and writable.
pub(crate) fn writable<'py, T: Element>(
    field: &str,
    value: &Bound<'py, PyAny>,
    shape: &[usize],
) -> PyResult<PyReadwriteArrayDyn<'py, T>> {
    let dtype = numpy::dtype::<T>(value.py());
    let array = value.cast::<PyArrayDyn<T>>().map_err(|_| wrong_dtype(field, &dtype, value))?;
    if array.shape() != shape {
        return Err(wrong_shape(field, shape, array.shape()));
    }
    if !array.is_c_contiguous() {
        return Err(invalid(field, "C-contiguous", "an array of another layout"));
    }
    array.try_readwrite().map_err(|error| rejected(field, error))
}

/// Describes a value for an error message: dtype and shape of an array, else the type.
fn describe(value: &Bound<'_, PyAny>) -> String {
    let Ok(array) = value.cast::<PyUntypedArray>() else {
        let name = value.get_type().name();
        return name.map_or_else(|_| "another type".to_owned(), |name| name.to_string());
    };
    format!("an array of dtype {} and shape {}", array.dtype(), format_shape(array.shape()))
}

/// Formats a shape as NumPy does, for example `(4, 3, 2)`.
fn format_shape(shape: &[usize]) -> String {
    match shape {
        [len] => format!("({len},)"),
        _ => format!("({})", shape.iter().map(ToString::to_string).collect::<Vec<_>>().join(", ")),
    }
}

fn not_numeric(field: &str, value: &Bound<'_, PyAny>) -> PyErr {
    invalid(field, "an array of numbers", describe(value))
}

fn wrong_shape(field: &str, expected: &[usize], found: &[usize]) -> PyErr {
    invalid(field, format!("an array of shape {}", format_shape(expected)), format_shape(found))
}

/// Builds the `ValueError` about an array that has another dtype, or about a value that is no array.
pub(crate) fn wrong_dtype(field: &str, dtype: impl Display, value: &Bound<'_, PyAny>) -> PyErr {
    invalid(field, format!("a NumPy array of dtype {dtype}"), describe(value))
}

/// Converts `value` by `numpy.asarray`; checks its shape and that its dtype is one of `kinds` (NumPy's letters).
fn numeric_array<'py>(
    field: &str,
    value: &Bound<'py, PyAny>,
    shape: &[usize],
    kinds: &str,
) -> PyResult<Bound<'py, PyUntypedArray>> {
    let numpy = value.py().import("numpy")?;
    let array = match value.cast::<PyUntypedArray>() {
        Ok(array) => array.clone(),
        Err(_) => numpy
            .call_method1("asarray", (value,))
            .ok()
            .and_then(|array| array.cast_into::<PyUntypedArray>().ok())
            .ok_or_else(|| not_numeric(field, value))?,
    };
    let kind = char::from(array.dtype().kind());
    if !kinds.contains(kind) {
        let expected = if kinds.contains('f') { "numbers" } else { "integers" };
        return Err(invalid(field, format!("an array of {expected}"), format!("dtype {}", array.dtype())));
    }
    if array.shape() != shape {
        return Err(wrong_shape(field, shape, array.shape()));
    }
    Ok(array)
}

/// Converts an array to C order and dtype `T`; returns the array itself if it already has both.
fn contiguous<'py, T: Element>(
    field: &str,
    array: &Bound<'py, PyUntypedArray>,
) -> PyResult<Bound<'py, PyArrayDyn<T>>> {
    let numpy = array.py().import("numpy")?;
    let converted = numpy.call_method1("ascontiguousarray", (array, numpy::dtype::<T>(array.py())))?;
    converted.cast_into::<PyArrayDyn<T>>().map_err(|_| not_numeric(field, array))
}

/// Result arrays of one shape that are reused once no caller holds them.
///
/// A caller that keeps an array, or a view of it, keeps its values. A caller that drops it causes no allocation.
pub(crate) struct ArrayRecycler<T> {
    shape: Vec<usize>,
    arrays: Vec<Py<PyArrayDyn<T>>>,
}

/// Arrays kept for reuse: the last result, the one before that the caller may still hold, and two spare ones.
const MAX_RECYCLED_ARRAYS: usize = 4;

impl<T: Element> ArrayRecycler<T> {
    /// Creates a recycler without arrays.
    pub(crate) fn new(shape: &[usize]) -> Self {
        Self { shape: shape.to_vec(), arrays: Vec::new() }
    }

    /// Shape of the arrays.
    pub(crate) fn shape(&self) -> &[usize] {
        &self.shape
    }

    /// Returns an array that no caller holds.
    pub(crate) fn acquire<'py>(&mut self, py: Python<'py>) -> Bound<'py, PyArrayDyn<T>> {
        #[expect(
            deprecated,
            reason = "the count is meaningless in an interpreter without GIL; abi3 modules do not load there"
        )]
        while let Some(free) = self.arrays.iter().position(|array| array.get_refcnt(py) == 1) {
            let array = self.arrays[free].bind(py).clone();
            if self.is_unmodified(&array) {
                return array;
            }
            self.arrays.remove(free);
        }
        let array = PyArrayDyn::zeros(py, IxDyn(&self.shape), false);
        if self.arrays.len() >= MAX_RECYCLED_ARRAYS {
            self.arrays.remove(0);
        }
        self.arrays.push(array.clone().unbind());
        array
    }

    /// True if no former holder changed shape, dtype or flags of the array in place.
    fn is_unmodified(&self, array: &Bound<'_, PyArrayDyn<T>>) -> bool {
        array.shape() == self.shape
            && array.is_c_contiguous()
            && array.dtype().is_equiv_to(&numpy::dtype::<T>(array.py()))
            && array.try_readwrite().is_ok()
    }
}
