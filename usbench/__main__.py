"""`python -m usbench` is `usbench`."""

from usbench.cli import main

raise SystemExit(main())
