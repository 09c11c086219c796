# SPDX-License-Identifier: Apache-2.0
"""Quality of service of the stack's topics (see docs/architecture.md): all keep the newest `depth` messages.

All are reliable, but for what sensors tell.
"""

from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

STREAM = QoSProfile(depth=2000)
"""The event stream: nothing may be missed, but a subscriber that sleeps must not block the bridge, as keep_all would."""

FACES = QoSProfile(depth=50, durability=DurabilityPolicy.TRANSIENT_LOCAL)
"""Faces: late joiners learn the last ones."""

LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
"""States: late joiners learn the newest."""

STATES = QoSProfile(depth=100)
"""Everything else that is published at a rate."""

SENSORS = QoSProfile(depth=500, reliability=ReliabilityPolicy.BEST_EFFORT)
"""How a subscriber hears any driver of a sensor, whether that is reliable or not. Ours is."""
