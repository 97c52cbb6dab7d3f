//! Slots in the order in which they were opened, until they are settled.
//!
//! A slot is settled once it has its value and all slots before it are settled. Blocks and mastery use settled slots
//! only. A trainer that reports good results early and keeps bad ones back therefore changes nothing: the good results
//! wait.

use std::collections::{BTreeMap, VecDeque};

use serde::{Deserialize, Serialize};

use super::interval::SuccessInterval;
use crate::core::slot::{Slot, SlotKey, StalledSlot};

/// Slots that are not settled yet, in the order of their opening.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
#[serde(from = "Vec<QueuedSlot>", into = "Vec<QueuedSlot>")]
pub(crate) struct SlotQueue {
    slots: VecDeque<QueuedSlot>,
    /// Position of each slot, counted from the first slot that the queue ever had.
    positions: BTreeMap<SlotKey, u64>,
    /// Position of the first slot in the queue.
    first: u64,
}

/// Slot in the queue. Stored as `[proposal, group, lease, state]`: a queue can be long, and snapshots repeat it.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(from = "StoredSlot", into = "StoredSlot")]
struct QueuedSlot {
    key: SlotKey,
    lease: u64,
    state: SlotState,
}

/// State of a slot in the queue.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(tag = "state", rename_all = "snake_case")]
enum SlotState {
    /// The slot has no value yet.
    Open,
    /// The slot has its value.
    Resolved(SuccessInterval),
    /// The slot will never have a value: the server lost the group before a trainer saw it.
    Withdrawn,
}

/// Stored form of a slot: its proposal, group, lease and state. Older snapshots have objects.
#[derive(Clone, Copy, Serialize, Deserialize)]
#[serde(untagged)]
enum StoredSlot {
    List(u64, u32, u64, StoredSlotState),
    Object {
        #[serde(flatten)]
        key: SlotKey,
        lease: u64,
        #[serde(flatten)]
        state: SlotState,
    },
}

/// Stored form of a slot's state: `null` if it is open, `false` if it was withdrawn, else its value as `[low, high]`.
#[derive(Clone, Copy, Serialize, Deserialize)]
#[serde(untagged)]
enum StoredSlotState {
    Open(()),
    Withdrawn(bool),
    Resolved([f64; 2]),
}

/// Slot with its value.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct SettledSlot {
    /// Seq of the proposal.
    pub(crate) proposal: u64,
    /// Value of the slot.
    pub(crate) value: SuccessInterval,
}

/// Queues are equal if they have the same slots, whatever they had before.
impl PartialEq for SlotQueue {
    fn eq(&self, other: &Self) -> bool {
        self.slots == other.slots
    }
}

impl SlotQueue {
    /// Appends a slot; does nothing if the queue has it.
    pub(crate) fn open(&mut self, slot: &Slot) {
        let position = self.first + self.slots.len() as u64;
        if let std::collections::btree_map::Entry::Vacant(vacant) = self.positions.entry(slot.key()) {
            vacant.insert(position);
            self.slots.push_back(QueuedSlot { key: slot.key(), lease: slot.lease, state: SlotState::Open });
        }
    }

    /// Sets the value of an open slot. Returns false if the queue does not have the slot, or if it has its value: only
    /// the first attempt counts.
    pub(crate) fn resolve(&mut self, key: SlotKey, value: SuccessInterval) -> bool {
        self.end(key, SlotState::Resolved(value))
    }

    /// Withdraws an open slot. Returns false if the queue does not have it, or if it has its value.
    pub(crate) fn withdraw(&mut self, key: SlotKey) -> bool {
        self.end(key, SlotState::Withdrawn)
    }

    fn end(&mut self, key: SlotKey, state: SlotState) -> bool {
        let Some(position) = self.positions.get(&key) else { return false };
        let index = usize::try_from(position - self.first).unwrap_or(usize::MAX);
        match self.slots.get_mut(index) {
            Some(slot) if slot.state == SlotState::Open => {
                slot.state = state;
                true
            }
            _ => false,
        }
    }

    /// Takes the next slot that is settled.
    pub(crate) fn next_settled(&mut self) -> Option<SettledSlot> {
        while let Some(front) = self.slots.front().copied() {
            if front.state == SlotState::Open {
                return None;
            }
            self.slots.pop_front();
            self.positions.remove(&front.key);
            self.first += 1;
            if let SlotState::Resolved(value) = front.state {
                return Some(SettledSlot { proposal: front.key.proposal, value });
            }
        }
        None
    }

    /// Number of slots without a value.
    pub(crate) fn open_count(&self) -> u32 {
        self.count(|slot| slot.state == SlotState::Open)
    }

    /// Number of slots that have their value and wait for an earlier slot.
    pub(crate) fn waiting_count(&self) -> u32 {
        self.count(|slot| matches!(slot.state, SlotState::Resolved(_)))
    }

    /// Sentence that says that at least `size` results wait for earlier slots, if they do.
    pub(crate) fn waiting_hold(&self, size: u32) -> Option<String> {
        let (open, waiting) = (self.open_count(), self.waiting_count());
        (waiting >= size).then(|| {
            format!(
                "{waiting} results wait for {open} leased {} without a result: results count in the order of \
                 the leases",
                if open == 1 { "scenario" } else { "scenarios" }
            )
        })
    }

    /// First open slot, if at least `min_later` slots of later leases have their result and wait for it.
    pub(crate) fn stalled(&self, min_later: u32) -> Option<StalledSlot> {
        let front = self.slots.front()?;
        if self.slots.len() <= min_later as usize {
            return None;
        }
        let later =
            self.count(|slot| slot.lease > front.lease && matches!(slot.state, SlotState::Resolved(_)));
        (later >= min_later).then_some(StalledSlot { key: front.key, lease: front.lease, later })
    }

    /// Number of slots in the queue.
    pub(crate) fn len(&self) -> usize {
        self.slots.len()
    }

    /// Seq of the earliest proposal in the queue.
    pub(crate) fn earliest_proposal(&self) -> Option<u64> {
        self.positions.first_key_value().map(|(key, _)| key.proposal)
    }

    fn count(&self, matches: impl Fn(&QueuedSlot) -> bool) -> u32 {
        u32::try_from(self.slots.iter().filter(|slot| matches(slot)).count()).unwrap_or(u32::MAX)
    }
}

impl From<StoredSlot> for QueuedSlot {
    fn from(stored: StoredSlot) -> Self {
        match stored {
            StoredSlot::List(proposal, group, lease, state) => {
                Self { key: SlotKey { proposal, group }, lease, state: state.into() }
            }
            StoredSlot::Object { key, lease, state } => Self { key, lease, state },
        }
    }
}

impl From<StoredSlotState> for SlotState {
    fn from(state: StoredSlotState) -> Self {
        match state {
            StoredSlotState::Open(()) => Self::Open,
            StoredSlotState::Withdrawn(_) => Self::Withdrawn,
            StoredSlotState::Resolved([low, high]) => Self::Resolved(SuccessInterval { low, high }),
        }
    }
}

impl From<QueuedSlot> for StoredSlot {
    fn from(QueuedSlot { key, lease, state }: QueuedSlot) -> Self {
        let state = match state {
            SlotState::Open => StoredSlotState::Open(()),
            SlotState::Withdrawn => StoredSlotState::Withdrawn(false),
            SlotState::Resolved(SuccessInterval { low, high }) => StoredSlotState::Resolved([low, high]),
        };
        Self::List(key.proposal, key.group, lease, state)
    }
}

impl From<Vec<QueuedSlot>> for SlotQueue {
    fn from(slots: Vec<QueuedSlot>) -> Self {
        let positions = (0..).zip(&slots).map(|(position, slot)| (slot.key, position)).collect();
        Self { slots: slots.into(), positions, first: 0 }
    }
}

impl From<SlotQueue> for Vec<QueuedSlot> {
    fn from(queue: SlotQueue) -> Self {
        queue.slots.into()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::core::proposal::ProposalRole;

    fn slot(proposal: u64, lease: u64) -> Slot {
        let task = "kessler/survival".to_owned();
        Slot { proposal, group: 0, lease, task, level: Some(0), epoch: 0, role: ProposalRole::Frontier }
    }

    fn key(proposal: u64) -> SlotKey {
        SlotKey { proposal, group: 0 }
    }

    const SUCCESS: SuccessInterval = SuccessInterval { low: 1.0, high: 1.0 };

    fn queue(slots: u64) -> SlotQueue {
        let mut queue = SlotQueue::default();
        (0..slots).for_each(|proposal| queue.open(&slot(proposal, proposal)));
        queue
    }

    #[test]
    fn slots_settle_in_the_order_of_opening() {
        let mut queue = queue(3);
        assert!(queue.resolve(key(1), SUCCESS) && queue.resolve(key(2), SuccessInterval::MISSING));
        assert_eq!((queue.next_settled(), queue.open_count(), queue.waiting_count()), (None, 1, 2));
        assert!(queue.resolve(key(0), SUCCESS));
        let settled: Vec<_> = std::iter::from_fn(|| queue.next_settled()).collect();
        assert_eq!(settled.iter().map(|slot| slot.proposal).collect::<Vec<_>>(), [0, 1, 2]);
        assert_eq!((settled[2].value, queue.len()), (SuccessInterval::MISSING, 0));
    }

    #[test]
    fn first_value_of_a_slot_stays() {
        let mut queue = queue(2);
        assert!(queue.resolve(key(1), SuccessInterval::MISSING));
        assert!(!queue.resolve(key(1), SUCCESS) && !queue.resolve(key(7), SUCCESS));
        queue.open(&slot(1, 9));
        queue.resolve(key(0), SUCCESS);
        assert_eq!(std::iter::from_fn(|| queue.next_settled()).count(), 2);
        assert!(!queue.resolve(key(1), SUCCESS), "the slot is settled");
    }

    #[test]
    fn withdrawn_slot_lets_the_later_ones_settle() {
        let mut queue = queue(2);
        queue.resolve(key(1), SUCCESS);
        assert!(queue.withdraw(key(0)) && !queue.withdraw(key(0)));
        assert_eq!(queue.next_settled().map(|slot| slot.proposal), Some(1));
        // The group is leased again.
        queue.open(&slot(0, 5));
        assert!(queue.resolve(key(0), SUCCESS));
    }

    #[test]
    fn stalled_slot_counts_results_of_later_leases_only() {
        let mut queue = SlotQueue::default();
        for (proposal, lease) in [(0, 4), (1, 4), (2, 5), (3, 3), (4, 6)] {
            queue.open(&slot(proposal, lease));
        }
        for proposal in 1..4 {
            queue.resolve(key(proposal), SUCCESS);
        }
        assert_eq!(queue.stalled(1), Some(StalledSlot { key: key(0), lease: 4, later: 1 }));
        assert_eq!(queue.stalled(2), None);
    }

    #[test]
    fn queue_round_trips_through_json() {
        let mut queue = queue(4);
        queue.resolve(key(2), SuccessInterval { low: 0.25, high: 0.5 });
        queue.withdraw(key(3));
        let stored = serde_json::to_string(&queue).unwrap();
        assert_eq!(stored, "[[0,0,0,null],[1,0,1,null],[2,0,2,[0.25,0.5]],[3,0,3,false]]");
        let objects = r#"[{"proposal":0,"group":0,"lease":0,"state":"open"},{"proposal":1,"group":0,"lease":1,"state":"open"},
            {"proposal":2,"group":0,"lease":2,"state":"resolved","low":0.25,"high":0.5},
            {"proposal":3,"group":0,"lease":3,"state":"withdrawn"}]"#;
        assert_eq!(serde_json::from_str::<SlotQueue>(objects).unwrap(), queue, "an older snapshot is read");
        let mut restored: SlotQueue = serde_json::from_str(&stored).unwrap();
        assert_eq!(restored, queue);
        assert!(restored.resolve(key(0), SUCCESS) && restored.next_settled().is_some());
        assert!(restored.resolve(key(1), SUCCESS));
        assert_eq!(std::iter::from_fn(|| restored.next_settled()).count(), 2);
    }
}
