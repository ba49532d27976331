"""How far the learned light is from the truth: metrics, figures, and a report for people and machines."""

from lightwell.report.html import WrittenReport as WrittenReport
from lightwell.report.html import write_report as write_report
from lightwell.report.records import PointComparison as PointComparison
from lightwell.report.records import ReportData as ReportData
from lightwell.report.records import ViewComparison as ViewComparison
from lightwell.report.summary import summary as summary
