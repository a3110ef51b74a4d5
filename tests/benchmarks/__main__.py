"""Pin every numerical library to one thread, before any is loaded; then measure."""

import os

os.environ.update(dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1"))

from .run import main

main()
