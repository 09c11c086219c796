# SPDX-License-Identifier: Apache-2.0
"""The node `hardware_bridge`: its services, its action, what it publishes and records; and the port's process."""
