"""Ends with 0 where a page answers with success: python health.py URL"""

import sys
import urllib.error
import urllib.request

# Never by a proxy: this asks the own container.
opener = urllib.request.build_opener(urllib.request.ProxyHandler({}))
try:
    with opener.open(sys.argv[1], timeout=4) as answer:
        print(answer.read().decode().strip())
except (OSError, urllib.error.URLError) as error:
    sys.exit(f"unhealthy: {error}")
