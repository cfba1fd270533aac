"""Files whose numbers could be read as others than they are: each is refused, or read as what it says."""

import time

import numpy as np
import pytest

from jbridge.errors import InputError
from jbridge.recordings.tables.csv_lines import drop_comments
from jbridge.recordings.tables.csv_table import read_csv


def read(tmp_path, text):
    return read_csv(tmp_path / "run.csv", text.encode())


def problem(tmp_path, text):
    with pytest.raises(InputError) as caught:
        read(tmp_path, text)
    return str(caught.value)


@pytest.mark.parametrize(
    "text",
    [
        "t;x\n0;998\n1;1,600\n2;1,612\n",
        't,x\n0,998\n1,"1,600"\n2,"1,612"\n',
        "t;x\n0;-1,600\n1;12,600\n",
        "t\tx\n0\t900\n1\t1,600\n",
    ],
)
def test_commas_that_may_separate_thousands_are_refused(tmp_path, text):
    message = problem(tmp_path, text)
    assert "column x" in message and "export without separators of thousands" in message


@pytest.mark.parametrize(
    ("text", "x"),
    [
        ("t;x\n0;0,600\n1;1,600\n", [0.6, 1.6]),
        ("t;x\n0,5;1,612\n1,5;1,600\n", [1.612, 1.6]),
        ('t,x\n0,"1,60"\n1,"1,612"\n', [1.6, 1.612]),
        ("t;x\n14:03:59,123;1,600\n14:03:59,223;1,612\n", [1.6, 1.612]),
    ],
)
def test_commas_that_are_decimal_are_read(tmp_path, text, x):
    np.testing.assert_array_equal(read(tmp_path, text).columns["x"], x)


@pytest.mark.parametrize("cell", ["#ZAHL!", "#N/A", "#BEZUG!", "#VALUE!"])
def test_an_error_of_a_spreadsheet_is_no_comment(tmp_path, cell):
    assert "row 3, column t" in problem(tmp_path, f"t,x\n0,1\n{cell},2\n2,3\n")
    assert "row 3, column t" in problem(tmp_path, f"t;x\n0;1\n{cell};2\n2;3\n")


def test_comments_of_other_widths_are_left_out(tmp_path):
    table = read(tmp_path, "# rig 3, May\nt,x\n0,1\n# stop\n1,2\n% a, b, c\n")
    np.testing.assert_array_equal(table.columns["x"], [1, 2])
    np.testing.assert_array_equal(table.row_numbers, [3, 5])


def test_many_comments_take_no_longer_each(tmp_path):
    def seconds(count):
        lines = ["# a"] * count + ["t,x", "0,1"]
        start = time.process_time()
        drop_comments(lines)
        return time.process_time() - start

    assert seconds(40_000) < 40 * max(seconds(4_000), 0.002)
