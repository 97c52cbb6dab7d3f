//! Downlink of stored data: Basilisk's `spaceToGroundTransmitter` with its storage units.
//!
//! The storage has two partitions: that of the instrument, and the initial data of an imager, which BSK-RL keeps apart.

/// Constants of a transmitter and its storage.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TransmitterSettings {
    /// Change of the stored data, bit/s; negative.
    pub baud: f64,
    /// Size of a packet as a negative number of bits: less than that is not sent.
    pub packet_bits: f64,
}

/// State of a transmitter.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Transmitter {
    /// Bits of the current packet that were sent, negative.
    sent_bits: f64,
    /// Partition that is sent.
    partition: usize,
    /// Time of the last tick in which the transmitter was on, s.
    last_s: f64,
}

impl Transmitter {
    /// Runs a tick at time `now_s` of length `step_s` in which the transmitter is on. Returns the change of each partition, bits.
    ///
    /// The first tick after a pause takes the whole pause for its length when it asks whether enough data are left, as in
    /// Basilisk; the data that it sends are those of one tick.
    pub fn tick(
        &mut self,
        now_s: f64,
        step_s: f64,
        has_access: bool,
        stored: [f64; 2],
        settings: &TransmitterSettings,
    ) -> [f64; 2] {
        let mut change = [0.0; 2];
        let pause_s = now_s - self.last_s;
        self.last_s = now_s;
        if self.sent_bits <= settings.packet_bits {
            self.sent_bits = 0.0;
        }
        // A partition that ran empty ends its packet, and Basilisk sends nothing in that tick.
        let ran_empty = self.sent_bits != 0.0 && stored[self.partition] <= 0.0;
        if ran_empty {
            self.sent_bits = 0.0;
        }
        if !has_access || (ran_empty && stored[0].max(stored[1]) <= 0.0) {
            self.sent_bits = 0.0;
            return change;
        }
        if self.sent_bits == 0.0 {
            self.partition = usize::from(stored[1] > stored[0]);
            if stored[self.partition] < -settings.packet_bits {
                return change;
            }
        }
        let left = stored[self.partition];
        if left + settings.baud * pause_s < 0.0 {
            self.sent_bits = -left;
        } else {
            self.sent_bits += settings.baud * pause_s;
        }
        if ran_empty {
            return change;
        }
        let sent = (settings.baud * step_s).round();
        change[self.partition] = if left + settings.baud * step_s >= 0.0 { sent } else { -left };
        change
    }

    /// Follows ticks without access up to a time, s: the packet is lost, and the next tick has the length of one tick.
    pub const fn skip_to(&mut self, now_s: f64) {
        self.sent_bits = 0.0;
        self.last_s = now_s;
    }
}
