# SPDX-License-Identifier: Apache-2.0
"""The driver of an inertial sensor behind a serial port: `sensor_msgs/Imu` as REP 145 has it, raw, in the sensor's own axes."""

import math
import threading
import time
from dataclasses import dataclass
from pathlib import Path

from geometry_msgs.msg import Quaternion, Vector3
from rclpy.node import Node
from sensor_msgs.msg import Imu
from std_msgs.msg import Header

from hardware_bridge.errors import BridgeError
from hardware_bridge.imu.sensor_port import SensorPort
from hardware_bridge.imu.wt901 import GRAVITY_M_S2, Measurement
from hardware_bridge.prototype_client.handshake import default_link, imu_path
from sim_core.structure.urdf import IMU as IMU_FRAME
from tensegrity_robot.ros import conversions, qos, topics
from tensegrity_robot.ros.diagnostics import OK, WARN, Part, diagnostics
from tensegrity_robot.ros.node_help import About
from tensegrity_robot.ros.node_parameters import declare_parameters, parameter
from tensegrity_robot.ros.node_process import STEADY, EndProcess, run

AGAIN_S = 1.0
"""Between attempts to open the port, wall time."""
LEAST_HZ = 50.0
"""With fewer measurements a second the turns between them are too large."""
RATE_VARIANCE, ACCELERATION_VARIANCE = math.radians(0.2) ** 2, (0.01 * GRAVITY_M_S2) ** 2


@dataclass(frozen=True)
class DriverParameters:
    """Parameters of the driver; the descriptions are what `ros2 param describe` shows."""

    port: str = parameter("", "device or socket://HOST:PORT of the sensor; empty: the virtual prototype's")
    sensor: str = parameter("wt901", "its kind: WitMotion WT901 and its family", choices=("wt901",))
    baud: int = parameter(0, "rate of the port; 0: 115200", low=0, high=1_000_000)


class ImuDriverNode(Node):
    """See the module. Bytes are read in a thread of their own, which also publishes."""

    def __init__(self, _end: EndProcess):
        super().__init__("imu_driver")
        self._settings = p = declare_parameters(self, DriverParameters)
        self._path = p.port or str(imu_path(default_link(self.get_namespace())))
        self._frame = conversions.frame_prefix(self) + IMU_FRAME
        self._published = topics.IMU_DATA.publisher(self, qos.STATES)
        self._diagnostics = topics.DIAGNOSTICS.publisher(self)
        self._port: SensorPort | None = None
        self._trouble = "not opened yet"
        self._told = (time.monotonic(), 0)
        self._ended = threading.Event()
        self._reader = threading.Thread(target=self._read, name="sensor", daemon=True)
        self._reader.start()
        self.create_timer(1.0, self._each_second, clock=STEADY)

    def halt(self) -> None:
        """Reads nothing more."""
        self._ended.set()

    def close(self) -> None:
        """Lets go of the port."""
        self._reader.join(timeout=2.0)

    def _read(self) -> None:
        while not self._ended.is_set():
            try:
                self._port = port = SensorPort(self._path, self._settings.baud)
            except BridgeError as error:
                self._fail(error)
                continue
            self.get_logger().info(f"sensor {self._settings.sensor} at {self._path}: ready")
            try:
                self._trouble = ""
                while not self._ended.is_set():
                    for made_s, measurement in port.read(0.1):
                        self._published.publish(self._message(made_s, measurement))
            except BridgeError as error:
                self._fail(error)
            finally:
                self._port = None
                port.close()

    def _fail(self, error: BridgeError) -> None:
        if str(error) != self._trouble:
            self.get_logger().warning(f"{error}; trying again each second")
        self._trouble = str(error)
        self._ended.wait(AGAIN_S)

    def _message(self, made_s: float, measurement: Measurement) -> Imu:
        stamp_ns = self.get_clock().now().nanoseconds - round((time.monotonic() - made_s) * 1e9)
        message = Imu(header=Header(stamp=conversions.stamp_of(stamp_ns), frame_id=self._frame))
        message.angular_velocity = Vector3(**dict(zip("xyz", measurement.rate_rad_s, strict=True)))
        message.linear_acceleration = Vector3(**dict(zip("xyz", measurement.acceleration_m_s2, strict=True)))
        if measurement.quaternion is None:
            message.orientation_covariance[0] = -1.0  # REP 145: it tells none
        else:
            message.orientation = Quaternion(**dict(zip("wxyz", measurement.quaternion, strict=True)))
        for axis in (0, 4, 8):
            message.angular_velocity_covariance[axis] = RATE_VARIANCE
            message.linear_acceleration_covariance[axis] = ACCELERATION_VARIANCE
        return message

    def _each_second(self) -> None:
        port, now_s = self._port, time.monotonic()
        count = port.measurements if port is not None else 0
        rate_hz = max(0.0, (count - self._told[1]) / (now_s - self._told[0]))
        self._told = (now_s, count)
        told = self._trouble or f"{rate_hz:.0f} measurements a second"
        slow = not self._trouble and rate_hz < LEAST_HZ
        if slow:
            told += f", {LEAST_HZ:g} are needed: set the sensor's return rate to 100 Hz, its and the driver's baud to {115200}"
            self.get_logger().warning(told, throttle_duration_sec=60.0)
        values = (("port", self._path), ("rate [Hz]", f"{rate_hz:.1f}"), ("bad bytes", port.bad_bytes if port else 0))
        part = Part("sensor", WARN if slow or self._trouble else OK, told, values)
        stamp = self.get_clock().now().to_msg()
        self._diagnostics.publish(diagnostics(self.get_fully_qualified_name().lstrip("/"), Path(self._path).name, [part], stamp))


ABOUT = About(
    name="imu_driver",
    text="reads an inertial sensor in the robot's box and publishes what it measures",
    settings=DriverParameters,
    gives="imu/data /diagnostics",
    takes="",
    example="-p port:=/dev/ttyUSB1",
)


def main() -> int:
    """The executable `imu_driver`."""
    return run(ImuDriverNode, ABOUT)
