# SPDX-License-Identifier: Apache-2.0
"""`python -m sixstrut_cli`: what `./sixstrut` runs once set-up is done."""

from sixstrut_cli.app import main

if __name__ == "__main__":
    main()
