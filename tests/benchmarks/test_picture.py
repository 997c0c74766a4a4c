"""The picture of README.md shows what the page says today."""

import json

from benchmarks import picture


def test_a_picture_keeps_its_text():
    end = b"\0\0\0\0IEND\xaeB`\x82"
    assert picture.text_of(b"\x89PNG" + end) == ""
    assert picture.text_of(picture.with_text(b"\x89PNG" + end, '{"a": 1}')) == '{"a": 1}'


def test_the_picture_is_of_the_page(new_tab, tmp_path):
    said = json.loads(picture.text_of(picture.PICTURE.read_bytes()))
    assert picture.opened(new_tab(), tmp_path) == said, "make picture draws it anew"
