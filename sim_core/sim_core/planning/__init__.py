# SPDX-License-Identifier: Apache-2.0
"""Which rolls to make: between faces, and to a point on the floor.

May import `rolling`, `twin` and what those may import; not `uncertainty`.
"""
