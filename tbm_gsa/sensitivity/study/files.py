"""Names of what a study leaves in its folder."""

from typing import Final

STORE_NAME: Final = "store.sqlite"
RESULT_NAME: Final = "result.json"
REPORT_NAME: Final = "report.html"
TABLES_NAME: Final = "tables"
