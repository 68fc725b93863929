"""What people read of a study, written into its folder: the page and the tables."""

from tbm_gsa.app.report.gsa_page import gsa_page
from tbm_gsa.app.report.gsa_tables import gsa_tables
from tbm_gsa.sensitivity.study.files import TABLES_NAME
from tbm_gsa.sensitivity.study.run import StudyResult
from tbm_msgs_py.base.files import write_whole


def write_study_report(study: StudyResult) -> None:
    """Write ``report.html`` and ``tables/*.csv`` of a finished study."""
    write_whole(study.report, gsa_page(study.document, study.analyses).encode())
    tables = study.folder / TABLES_NAME
    tables.mkdir(exist_ok=True)
    for name, text in gsa_tables(study.document).items():
        write_whole(tables / name, text.encode())
