# SPDX-License-Identifier: Apache-2.0
"""Before a robot moves: the doctor's checks, and calibrating with a person."""
