"""Trace of one satellite: values of every tick, after the flight software of that tick."""

from __future__ import annotations

from typing import Any

from Basilisk.utilities import macros

# The world has priority 300, dynamics 200 and flight software 100.
TRACE_PRIORITY = 1
WHEELS = 3
THRUSTERS = 8


class Trace:
    """Recorders of Basilisk messages in a process that runs last in each tick."""

    def __init__(self, satellite: Any) -> None:
        """Creates the process and its recorders for a satellite whose simulator is under construction."""
        simulator, dynamics, fsw = satellite.simulator, satellite.dynamics, satellite.fsw
        process = simulator.CreateNewProcess("Trace" + satellite.name, TRACE_PRIORITY)
        task = "TraceTask" + satellite.name
        process.addTask(simulator.CreateNewTask(task, macros.sec2nano(simulator.sim_rate)))
        self.recorders = {
            "state": dynamics.scObject.scStateOutMsg.recorder(),
            "wheels": dynamics.rwStateEffector.rwSpeedOutMsg.recorder(),
            "battery": dynamics.powerMonitor.batPowerOutMsg.recorder(),
            "storage": dynamics.storageUnit.storageUnitDataOutMsg.recorder(),
            "torque": fsw.rwMotorTorque.rwMotorTorqueOutMsg.recorder(),
            "thrusters": fsw.thrDump.thrusterOnTimeOutMsg.recorder(),
        }
        for recorder in self.recorders.values():
            simulator.AddModelToTask(task, recorder)

    def values(self) -> dict[str, Any]:
        """Returns the series by quantity; thruster commands only at ticks that command a thrust."""
        logs = self.recorders
        times = logs["state"].times()
        thrusters = logs["thrusters"]
        written = thrusters.timesWritten()
        return {
            "t": [float(time * macros.NANO2SEC) for time in times],
            "sigma_BN": logs["state"].sigma_BN.tolist(),
            "omega_BN_B": logs["state"].omega_BN_B.tolist(),
            "wheel_speeds_rad_s": logs["wheels"].wheelSpeeds[:, :WHEELS].tolist(),
            "battery_Ws": logs["battery"].storageLevel.tolist(),
            "net_power_W": logs["battery"].currentNetPower.tolist(),
            "storage_bits": logs["storage"].storageLevel.tolist(),
            "motor_torque_command_Nm": logs["torque"].motorTorque[:, :WHEELS].tolist(),
            "thruster_on_time_s": [
                [float(time * macros.NANO2SEC), thrusters.OnTimeRequest[index][:THRUSTERS].tolist()]
                for index, time in enumerate(times)
                if written[index] == time and thrusters.OnTimeRequest[index].any()
            ],
        }
