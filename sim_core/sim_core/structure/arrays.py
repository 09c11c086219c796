# SPDX-License-Identifier: Apache-2.0
"""The type of every array of numbers here."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
