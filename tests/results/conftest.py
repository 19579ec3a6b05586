"""What the tests of results share: tables made by hand."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))  # for `import tables`; pytest's importlib mode does not do it
