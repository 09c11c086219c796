# SPDX-License-Identifier: Apache-2.0
"""The nodes `imu_driver` and `face_estimator`: an inertial sensor in the box, and what it tells about the face."""
