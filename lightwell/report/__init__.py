"""Compare learned light with the path-traced reference: metrics, figures, and a report as JSON and HTML."""

from lightwell.report.html import WrittenReport as WrittenReport
from lightwell.report.html import write_report as write_report
from lightwell.report.records import PointComparison as PointComparison
from lightwell.report.records import ReportData as ReportData
from lightwell.report.records import ViewComparison as ViewComparison
from lightwell.report.summary import summary as summary
