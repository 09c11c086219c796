# SPDX-License-Identifier: Apache-2.0
from sixstrut_cli.app import main

if __name__ == "__main__":
    main()
