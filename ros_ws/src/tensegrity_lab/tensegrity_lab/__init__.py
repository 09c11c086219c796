# SPDX-License-Identifier: Apache-2.0
"""Experiments with the robot, for a program: sessions of trials, studies, reports. No command line."""
