//! Arrays in and out: what callers give is checked by dtype, shape and layout; what they get is written in place.

use numpy::{
    Element, IxDyn, PyArray1, PyArrayDescrMethods, PyArrayDyn, PyArrayMethods, PyReadwriteArrayDyn,
    PyUntypedArray, PyUntypedArrayMethods,
};
use pyo3::prelude::*;

use crate::errors::invalid;

/// `numpy.asarray` of anything, and that it is an array of plain numbers of this shape.
fn numbers<'py>(
    field: &str,
    given: &Bound<'py, PyAny>,
    shape: &[usize],
    kinds: &str,
) -> PyResult<Bound<'py, PyUntypedArray>> {
    let numpy = given.py().import("numpy")?;
    let array = match given.cast::<PyUntypedArray>() {
        Ok(array) => array.clone(),
        Err(_) => numpy
            .call_method1("asarray", (given,))
            .ok()
            .and_then(|array| array.cast_into::<PyUntypedArray>().ok())
            .ok_or_else(|| invalid(field, "not an array of numbers"))?,
    };
    let kind = char::from(array.dtype().kind());
    if !kinds.contains(kind) {
        let wanted = if kinds.contains('f') { "numbers" } else { "whole numbers" };
        return Err(invalid(field, format!("dtype {} holds no {wanted}", array.dtype())));
    }
    if array.shape() != shape {
        return Err(invalid(field, format!("shape {:?}, not {shape:?}", array.shape())));
    }
    Ok(array)
}

/// The same as a C-ordered array of this dtype: the array itself where it is one.
fn ordered<'py, T: Element>(
    field: &str,
    array: &Bound<'py, PyUntypedArray>,
) -> PyResult<Bound<'py, PyArrayDyn<T>>> {
    let numpy = array.py().import("numpy")?;
    let made = numpy.call_method1("ascontiguousarray", (array, numpy::dtype::<T>(array.py())))?;
    made.cast_into::<PyArrayDyn<T>>().map_err(|_| invalid(field, "not an array of numbers"))
}

/// Copies numbers of this shape into `into`, as f32.
pub(crate) fn copy_f32(
    field: &str,
    given: &Bound<'_, PyAny>,
    shape: &[usize],
    into: &mut Vec<f32>,
) -> PyResult<()> {
    into.clear();
    if let Ok(array) = given.cast::<PyArrayDyn<f32>>()
        && array.shape() == shape
        && let Ok(read) = array.try_readonly()
        && let Ok(values) = read.as_slice()
    {
        into.extend_from_slice(values);
        return Ok(());
    }
    let array = numbers(field, given, shape, "fiu")?;
    let array = ordered::<f32>(field, &array)?;
    let read = array.try_readonly().map_err(|error| invalid(field, error))?;
    into.extend_from_slice(read.as_slice().map_err(|error| invalid(field, error))?);
    Ok(())
}

/// Whole numbers of this shape.
pub(crate) fn read_i64(field: &str, given: &Bound<'_, PyAny>, shape: &[usize]) -> PyResult<Vec<i64>> {
    let array = ordered::<i64>(field, &numbers(field, given, shape, "iu")?)?;
    array.to_vec().map_err(|error| invalid(field, error))
}

/// Numbers of any length along the first axis, and of this shape along the others; whether they are in single precision.
pub(crate) fn read_f64(
    field: &str,
    given: &Bound<'_, PyAny>,
    inner: &[usize],
) -> PyResult<(Vec<f64>, usize, bool)> {
    let numpy = given.py().import("numpy")?;
    let array =
        numpy.call_method1("asarray", (given,)).map_err(|_| invalid(field, "not an array of numbers"))?;
    let array = array.cast::<PyUntypedArray>().map_err(|_| invalid(field, "not an array of numbers"))?;
    let rows = array.shape().first().copied().unwrap_or(0);
    let shape: Vec<usize> = std::iter::once(rows).chain(inner.iter().copied()).collect();
    let single = array.dtype().itemsize() <= size_of::<f32>() && char::from(array.dtype().kind()) == 'f';
    let array = ordered::<f64>(field, &numbers(field, array, &shape, "fiu")?)?;
    Ok((array.to_vec().map_err(|error| invalid(field, error))?, rows, single))
}

/// A mask of this length.
pub(crate) fn read_mask(field: &str, given: &Bound<'_, PyAny>, len: usize) -> PyResult<Vec<bool>> {
    let wanted = || invalid(field, format!("not a numpy array of {len} bools"));
    let mask = given.cast::<PyArray1<bool>>().map_err(|_| wanted())?;
    let mask: Vec<bool> = mask.try_readonly().map_err(|error| invalid(field, error))?.as_array().to_vec();
    if mask.len() == len { Ok(mask) } else { Err(wanted()) }
}

/// A caller's array, to be written: of just this dtype and shape, C-ordered, and writable.
pub(crate) fn writable<'py, T: Element>(
    field: &str,
    given: &Bound<'py, PyAny>,
    shape: &[usize],
) -> PyResult<PyReadwriteArrayDyn<'py, T>> {
    let dtype = numpy::dtype::<T>(given.py());
    let array = given
        .cast::<PyArrayDyn<T>>()
        .map_err(|_| invalid(field, format!("not a numpy array of dtype {dtype}")))?;
    if array.shape() != shape {
        return Err(invalid(field, format!("shape {:?}, not {shape:?}", array.shape())));
    }
    if !array.is_c_contiguous() {
        return Err(invalid(field, "not C-contiguous"));
    }
    array.try_readwrite().map_err(|error| invalid(field, error))
}

/// Arrays that are handed out and, once nobody has them any more, written again: who holds on to an array, or to a view of it,
/// keeps it as it was; who does not pays for no memory.
pub(crate) struct Shelf<T> {
    shape: Vec<usize>,
    arrays: Vec<Py<PyArrayDyn<T>>>,
}

/// Arrays that are kept for the next step: what was returned last, what the caller still holds of the step before, and one more.
const KEPT: usize = 4;

impl<T: Element> Shelf<T> {
    pub(crate) fn new(shape: &[usize]) -> Self {
        Self { shape: shape.to_vec(), arrays: Vec::new() }
    }

    pub(crate) fn shape(&self) -> &[usize] {
        &self.shape
    }

    /// An array that nobody else has.
    pub(crate) fn take<'py>(&mut self, py: Python<'py>) -> Bound<'py, PyArrayDyn<T>> {
        #[expect(
            deprecated,
            reason = "the count means nothing in an interpreter without its lock; abi3 modules do not load there"
        )]
        while let Some(free) = self.arrays.iter().position(|array| array.get_refcnt(py) == 1) {
            let array = self.arrays[free].bind(py).clone();
            if self.is_whole(&array) {
                return array;
            }
            self.arrays.remove(free);
        }
        let made = PyArrayDyn::zeros(py, IxDyn(&self.shape), false);
        if self.arrays.len() >= KEPT {
            self.arrays.remove(0);
        }
        self.arrays.push(made.clone().unbind());
        made
    }

    /// Who had an array may have changed its shape, its dtype or its flags in place.
    fn is_whole(&self, array: &Bound<'_, PyArrayDyn<T>>) -> bool {
        array.shape() == self.shape
            && array.is_c_contiguous()
            && array.dtype().is_equiv_to(&numpy::dtype::<T>(array.py()))
            && array.try_readwrite().is_ok()
    }
}
