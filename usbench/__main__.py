"""`python -m usbench` is `usbench`."""

from usbench_command import main

raise SystemExit(main())
