"""Tables as CSV and XLSX."""

import csv

import openpyxl
import pytest

from resting_aspects_ros.report.format import interval_text, probability_text, share_text
from resting_aspects_ros.report.table import Table, save_csv, save_xlsx, table_values
from resting_aspects_ros.statistics.intervals import Interval

THIRD = Interval(1 / 3, 0.25, 0.421)


@pytest.fixture
def table():
    headings = ('aspects', 'rests on', 'proba-\nbility', '95 %\ninterval', 'barrier\n(mm)', 'n')
    made = Table('nut: 3 drops?', headings, texts={'rests on'})
    made.add_row('1 to 6', '12 mm', probability_text(THIRD), interval_text(THIRD), '1.5', '30')
    made.add_row('7', '-', '-', '', '', '0')
    return made


def test_values_are_exact_numbers_with_units_in_the_headings(table):
    headings, rows = table_values(table)
    interval = ['95 % interval lower (%)', '95 % interval upper (%)']
    assert headings == [
        'aspects', 'rests on', 'probability (%)', *interval, 'barrier (mm)', 'n'
    ]  # fmt: skip
    assert rows[0] == ['1 to 6', '12 mm', pytest.approx(100 / 3, rel=1e-14), 25, 42.1, 1.5, 30]
    assert rows[1] == [7, None, None, None, None, None, 0]


@pytest.mark.parametrize(
    ('cell', 'values'),
    [
        ('1.5e-3', [0.0015]),
        ('+3.1 (-0.9 to +7.0)', [3.1, -0.9, 7]),
        ('24.6\n21.9-27.5', [24.6, 21.9, 27.5]),
        (share_text(0.123456), [12.3456]),
        ('< 0.001', ['< 0.001']),
    ],
)
def test_texts_are_read_as_numbers_and_intervals(cell, values):
    table = Table('', ('x',), rows=[[cell]])
    assert table_values(table)[1] == [values]


def test_both_formats_have_the_same_values(table, tmp_path):
    save_csv(table, tmp_path / 't.csv')
    save_xlsx([table, table], tmp_path / 't.xlsx')
    headings, rows = table_values(table)
    with (tmp_path / 't.csv').open(newline='', encoding='utf-8') as file:
        read = list(csv.reader(file))
    texts = [['' if each is None else str(each) for each in row] for row in rows]
    assert read == [headings, *texts]
    book = openpyxl.load_workbook(tmp_path / 't.xlsx')
    assert len(book.sheetnames) == 2
    for sheet in book:
        assert [list(row) for row in sheet.iter_rows(values_only=True)] == [headings, *rows]


@pytest.mark.parametrize(
    ('cells', 'heading', 'values'),
    [
        (['60 mm', '161 mm'], 'x (mm)', [60, 161]),
        (['60 mm', '5.0 %'], 'x', ['60 mm', '5.0 %']),
        (['60', '-'], 'x', [60, None]),
    ],
)
def test_common_unit_is_in_the_heading(cells, heading, values):
    headings, rows = table_values(Table('', ('x',), rows=[[cell] for cell in cells]))
    assert headings == [heading]
    assert [row[0] for row in rows] == values
