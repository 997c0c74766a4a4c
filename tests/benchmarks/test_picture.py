"""The pictures of README.md and of the documents show what the page says today."""

import json

from benchmarks import picture


def test_a_picture_keeps_its_text():
    end = b"\0\0\0\0IEND\xaeB`\x82"
    assert picture.text_of(b"\x89PNG" + end) == ""
    assert picture.text_of(picture.with_text(b"\x89PNG" + end, '{"a": 1}')) == '{"a": 1}'


def test_the_pictures_are_of_the_page(new_tab, tmp_path):
    tab = new_tab()
    picture.opened(tab, tmp_path)
    for one in picture.PICTURES:
        said = json.loads(picture.text_of(one.path.read_bytes()))
        assert picture.shown(tab, one)[1] == said, f"{one.path}: make picture draws it anew"
