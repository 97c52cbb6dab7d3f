//! A model, prepared for the sizes of one environment's observations and actions.

use env_core::batch::{BatchShape, ObservationPart};
use env_core::space::ActionGrid;
use tract_onnx::prelude::*;
use tract_onnx::tract_core::internal::DimLike;
use tract_onnx::tract_hir::infer::{DimFact, Factoid};

/// Input of a network: a range of the environment's observation, and its shape.
#[derive(Debug, Clone, PartialEq, Eq)]
struct NetworkInput {
    shape: Vec<usize>,
    first: usize,
    len: usize,
}

/// Form of a network's output.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum OutputForm {
    /// Values of the actions of all agents.
    Continuous,
    /// A value for each choice of each agent; the largest one is chosen.
    Logits { choices: usize },
    /// The index of each agent's choice.
    Indices { choices: usize },
}

/// A model that is ready to run.
#[derive(Debug)]
pub(super) struct Network {
    plan: Arc<TypedRunnableModel>,
    inputs: Vec<NetworkInput>,
    form: OutputForm,
    /// Actions of the choices, one after the other; empty for continuous actions.
    grid: Vec<f32>,
    agents: usize,
    action: usize,
}

impl Network {
    /// Prepares a model for an environment. Discrete actions choose from `grid`.
    ///
    /// # Errors
    /// Returns a reason if the inputs or the output do not fit, or tract does not know an operator.
    pub(super) fn prepare(
        model: &InferenceModel,
        grid: &ActionGrid,
        parts: &[ObservationPart],
        shape: BatchShape,
    ) -> Result<Self, String> {
        let inputs = match_inputs(model, parts, shape)?;
        let mut model = model.clone();
        let failed = |error: TractError| format!("{error:#}");
        for (at, input) in inputs.iter().enumerate() {
            model.set_input_fact(at, f32::fact(&input.shape).into()).map_err(failed)?;
        }
        let plan = model.into_optimized().and_then(|model| model.into_runnable()).map_err(failed)?;
        let grid: Vec<f32> = grid.rows.concat();
        let choices = grid.len() / shape.action.max(1);
        let mut network = Self {
            plan,
            inputs,
            form: OutputForm::Continuous,
            grid,
            agents: shape.agents,
            action: shape.action,
        };
        let output = network.evaluate(&vec![0.0; shape.observation])?;
        network.form = network.output_form(&output, choices)?;
        Ok(network)
    }

    /// True if the network chooses among the task's discrete actions.
    pub(super) const fn is_discrete(&self) -> bool {
        !matches!(self.form, OutputForm::Continuous)
    }

    /// Computes the actions of all agents.
    ///
    /// # Errors
    /// Returns a reason if the network fails or has an output that is not an action.
    pub(super) fn act(&self, observation: &[f32]) -> Result<Vec<f32>, String> {
        let output = self.evaluate(observation)?;
        let chosen = match self.form {
            OutputForm::Continuous => {
                let values = floats(&output)?;
                return match values.iter().position(|value| !value.is_finite()) {
                    None => Ok(values.to_vec()),
                    Some(at) => Err(format!("the action of agent {} is not finite", at / self.action.max(1))),
                };
            }
            OutputForm::Logits { choices } => {
                let largest = |(agent, row): (usize, &[f32])| match largest_index(row) {
                    Some(index) => Ok(index),
                    None => Err(format!("a logit of agent {agent} is NaN")),
                };
                floats(&output)?
                    .chunks_exact(choices.max(1))
                    .enumerate()
                    .map(largest)
                    .collect::<Result<Vec<_>, _>>()?
            }
            OutputForm::Indices { choices } => {
                let indices = output.to_plain_array_view::<i64>().map_err(|error| error.to_string())?;
                let check = |(agent, index): (usize, &i64)| {
                    let index = usize::try_from(*index).ok().filter(|index| *index < choices);
                    index.ok_or_else(|| {
                        format!("the choice of agent {agent} must be from 0 to {}", choices.saturating_sub(1))
                    })
                };
                indices.iter().enumerate().map(check).collect::<Result<Vec<_>, _>>()?
            }
        };
        let row = |index: usize| &self.grid[index * self.action..(index + 1) * self.action];
        Ok(chosen.into_iter().flat_map(row).copied().collect())
    }

    /// Runs the network and returns its first output.
    pub(super) fn evaluate(&self, observation: &[f32]) -> Result<Tensor, String> {
        let tensor = |input: &NetworkInput| {
            Tensor::from_shape(&input.shape, &observation[input.first..input.first + input.len])
                .map(TValue::from)
        };
        let inputs = self.inputs.iter().map(tensor).collect::<TractResult<TVec<_>>>();
        let outputs =
            inputs.and_then(|inputs| self.plan.run(inputs)).map_err(|error| format!("{error:#}"))?;
        outputs
            .into_iter()
            .next()
            .map(TValue::into_tensor)
            .ok_or_else(|| "the model has no output".to_owned())
    }

    /// Finds out what an output of these dimensions means.
    fn output_form(&self, output: &Tensor, choices: usize) -> Result<OutputForm, String> {
        let (dims, values) = (output.shape(), output.shape().iter().product::<usize>());
        let last = dims.last().copied().unwrap_or_default();
        if output.datum_type() == i64::datum_type() && values == self.agents {
            return Ok(OutputForm::Indices { choices });
        }
        let is_float = output.datum_type() == f32::datum_type();
        let ends_with = |width: usize| last == width || last == self.agents * width;
        if is_float && values == self.agents * self.action && ends_with(self.action) {
            return Ok(OutputForm::Continuous);
        }
        if is_float && values == self.agents * choices && ends_with(choices) {
            return Ok(OutputForm::Logits { choices });
        }
        let (datum, agents, action) = (output.datum_type(), self.agents, self.action);
        Err(format!(
            "its output has the shape {dims:?} of {datum:?}; {agents} agents need [{agents}, {action}] of F32 for continuous actions, \
             [{agents}, {choices}] of F32 for the logits of discrete ones, or [{agents}] of I64 for their indices"
        ))
    }
}

/// Index of the largest value, the first of equal ones; `None` if a value is NaN.
fn largest_index(row: &[f32]) -> Option<usize> {
    let mut best = 0;
    for (index, value) in row.iter().enumerate() {
        if value.is_nan() {
            return None;
        }
        if *value > row[best] {
            best = index;
        }
    }
    Some(best)
}

/// Values of a tensor in single precision.
fn floats(tensor: &Tensor) -> Result<&[f32], String> {
    let view = tensor.to_plain_array_view::<f32>().map_err(|error| error.to_string())?;
    view.to_slice().ok_or_else(|| "the output is not contiguous".to_owned())
}

/// Matches the inputs of a model with the parts of an observation: by name, or else one input with a row for each agent or with the
/// whole observation.
fn match_inputs(
    model: &InferenceModel,
    parts: &[ObservationPart],
    shape: BatchShape,
) -> Result<Vec<NetworkInput>, String> {
    let outlets = model.input_outlets().map_err(|error| error.to_string())?;
    let names: Vec<&str> = outlets.iter().map(|outlet| model.node(outlet.node).name.as_str()).collect();
    if names.iter().all(|name| parts.iter().any(|part| part.name == *name)) && !names.is_empty() {
        return Ok(names.iter().filter_map(|name| named_input(name, parts)).collect());
    }
    let [_] = names.as_slice() else {
        let known: Vec<&str> = parts.iter().map(|part| part.name).collect();
        return Err(format!(
            "its inputs are {}; it must have one input, or inputs with the names {}",
            names.join(", "),
            known.join(", ")
        ));
    };
    let dims = declared_shape(model)?;
    let whole = NetworkInput { shape: vec![1, shape.observation], first: 0, len: shape.observation };
    let width = shape.observation / shape.agents.max(1);
    let has_agent_rows = matches!(parts, [part] if part.shape.len() == 2 && part.shape[0] == shape.agents);
    let rows = NetworkInput { shape: vec![shape.agents, width], ..whole.clone() };
    let fits = |dim: Option<usize>, wanted: usize| dim.is_none_or(|dim| dim == wanted);
    match dims.as_slice() {
        [_, last] if has_agent_rows && fits(*last, width) => Ok(vec![rows]),
        [_, agents, last] if has_agent_rows && fits(*agents, shape.agents) && fits(*last, width) => {
            Ok(vec![NetworkInput { shape: vec![1, shape.agents, width], ..whole }])
        }
        [_, last] if fits(*last, shape.observation) => Ok(vec![whole]),
        _ => {
            let dims: Vec<String> =
                dims.iter().map(|dim| dim.map_or_else(|| "?".to_owned(), |dim| dim.to_string())).collect();
            let wanted = if has_agent_rows { width } else { shape.observation };
            let of = if has_agent_rows { "an agent" } else { "the environment" };
            Err(format!(
                "its input has the shape [{}]; the observation of {of} has {wanted} values",
                dims.join(", ")
            ))
        }
    }
}

/// Input with the name of a part.
fn named_input(name: &str, parts: &[ObservationPart]) -> Option<NetworkInput> {
    let mut first = 0;
    for part in parts {
        let len = part.shape.iter().product();
        if part.name == name {
            let shape = std::iter::once(1).chain(part.shape.iter().copied()).collect();
            return Some(NetworkInput { shape, first, len });
        }
        first += len;
    }
    None
}

/// Dimensions that the model declares for its first input; `None` for a dynamic one.
fn declared_shape(model: &InferenceModel) -> Result<Vec<Option<usize>>, String> {
    let fact = model.input_fact(0).map_err(|error| error.to_string())?;
    let dim = |dim: &DimFact| dim.concretize().and_then(|dim| dim.to_usize().ok());
    Ok(fact.shape.dims().map(dim).collect())
}
