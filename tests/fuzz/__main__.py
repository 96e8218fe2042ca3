"""``python tests/fuzz --cases 20000``: the long run."""

import sys
from pathlib import Path

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).parents[1]))  # as pytest has it

    from fuzz.run import main

    sys.exit(main())
