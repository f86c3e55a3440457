"""Text and tables as programs and people write them."""

import pytest

from sextant.errors import UserError
from sextant.user_files import absent, check_columns, nearest_path, read_lines, read_table, read_text, table_header


@pytest.mark.parametrize(
    ("given", "near"),
    [
        ("images.txt", None), ("imags", "images"), ("IMAGES", "images"), ("images/1.png", "images/1.jpg"),
        ("iamges/1.jpg", "images"), ("poses.cvs", "poses.csv"), ("zzzz/yyyy", None),
    ],
)  # fmt: skip
def test_a_path_that_does_not_exist_has_the_nearest_name(tmp_path, given, near):
    (tmp_path / "images").mkdir()
    for name in ("images/1.jpg", "poses.csv"):
        (tmp_path / name).write_text("")
    said = absent(tmp_path / given)
    assert said.startswith(f"{tmp_path / given} does not exist")
    if given != "images.txt":  # images may count as similar
        assert nearest_path(tmp_path / given) == (near and tmp_path / near)
        assert ("did you mean" in said) == (near is not None)


def test_a_broken_link_and_a_file_in_place_of_a_folder_are_named(tmp_path):
    link, file = tmp_path / "link.jpg", tmp_path / "a.jpg"
    link.symlink_to("gone.jpg")
    file.write_text("")
    assert absent(tmp_path) == f"{tmp_path} is a folder"
    assert absent(link) == f"{link} is a broken link to gone.jpg"
    assert absent(link / "b") == f"{link / 'b'} does not exist: {link} is a broken link to gone.jpg"
    assert absent(file / "b") == f"{file / 'b'} does not exist: {file} is a file"


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "utf-32"])
@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
def test_text_of_every_encoding_with_a_mark_and_every_end_of_line_is_read(tmp_path, encoding, end):
    (path := tmp_path / "a.txt").write_bytes(f"1 é{end}{end}  # a comment{end}2\t3 ,{end}".encode(encoding))
    assert read_lines(path) == [(1, ["1", "é"]), (4, ["2", "3"])]


@pytest.mark.parametrize(
    ("content", "byte"), [(b"gr\xf6\xdfe", "2"), ("a".encode("utf-16-le"), "1"), (b"\x89PNG\r\n", "0"), (b"ab\0", "2")]
)
def test_what_is_no_text_is_refused_with_its_byte(tmp_path, content, byte):
    (path := tmp_path / "a.txt").write_bytes(content)
    with pytest.raises(UserError, match=rf"a\.txt cannot be read: byte {byte} is not text in UTF-8\nSave it"):
        read_text(path)


@pytest.mark.parametrize("separator", [",", ";", "\t", "|"])
@pytest.mark.parametrize("mark", ["", "\ufeff"])
@pytest.mark.parametrize("more", ["", "sep"])
@pytest.mark.parametrize("decimal", [".", ","])
def test_tables_are_read_whatever_separates_their_cells(tmp_path, separator, mark, more, decimal):
    if separator == decimal:
        return
    end = separator if more else ""
    lines = ["# a comment", f"File{separator} X{separator}y{end}", "", f"a.jpg{separator}1{decimal}5{separator}-2{end}"]
    (path := tmp_path / "t.csv").write_text(mark + "\r\n".join(lines), encoding="utf-8")
    table = read_table(path)
    assert table.header == table_header(path) == ("file", "x", "y")
    ((line, cells),) = table.rows
    assert line == 4
    assert [cells[0], *map(table.number, cells[1:3])] == ["a.jpg", 1.5, -2.0]
    assert list(table.long_rows()) == []


@pytest.mark.parametrize(
    ("text", "header", "rows"),
    [
        ("", (), []), ("# only a comment\n", (), []), ("file\na.jpg\n", ("file",), [["a.jpg"]]),
        ("#time [ns],x,y\n1,2,3\n", ("time [ns]", "x", "y"), [["1", "2", "3"]]),
        ("# a, b\n1,2,3\n", ("1", "2", "3"), []), ("0,5;1,5;2\n1;2;3\n", ("0,5", "1,5", "2"), [["1", "2", "3"]]),
        ('file,x\n"a,b.jpg",1\n', ("file", "x"), [["a,b.jpg", "1"]]),
        ("file;x\na,b.jpg;1\n", ("file", "x"), [["a,b.jpg", "1"]]),
    ],
)  # fmt: skip
def test_headers_and_cells(tmp_path, text, header, rows):
    (path := tmp_path / "t.csv").write_text(text)
    table = read_table(path)
    assert (table.header, [cells for _, cells in table.rows]) == (header, rows)


def test_a_column_that_is_used_is_there_once():
    check_columns("t.csv", ("file", "note", "note", "x"), ("file", "x", "y"))
    with pytest.raises(UserError, match=r"t\.csv has 3 columns named x"):
        check_columns("t.csv", ("x", "x", "y", "x"), ("file", "x", "y"))


@pytest.mark.parametrize("cell", ["", "x", "nan", "inf", "1.234,5", "1,2,3", "1 000"])
def test_what_is_no_number(tmp_path, cell):
    (path := tmp_path / "t.csv").write_text("a;b\n")
    assert read_table(path).number(cell) is None


def test_decimal_commas_between_commas_and_mixed_marks_are_refused(tmp_path):
    (path := tmp_path / "t.csv").write_text("file,x,y\na.jpg,1,5,2,5\n")
    (said,) = read_table(path).long_rows()
    assert said == "line 2: 5 values for 3 columns: decimal commas? Separate cells by ; then"
    path.write_text("x;y\n1,5;2.5\n")
    table = read_table(path)
    with pytest.raises(UserError, match=r"t\.csv has decimal commas and decimal points, such as 2\.5"):
        list(map(table.number, table.rows[0][1]))
