"""The progress line on a terminal."""

from io import StringIO

from lassokin_ros.common.progress import Progress


class Terminal(StringIO):
    def isatty(self):
        return True


def line(progress_total, count):
    stream = Terminal()
    progress = Progress(progress_total, "images", stream)
    progress._next = 0.0  # draw at once
    progress.advance(count, "tracking")
    return stream.getvalue()


def test_the_time_left_is_shown_when_it_is_known():
    assert "1/1000 images tracking" in line(1000, 1) and "left" not in line(1000, 1)
    assert "500/1000 images, 0 s left tracking" in line(1000, 500)


def test_an_unknown_total_shows_the_count_alone():
    assert line(0, 57).startswith("\r57 images tracking") and "[" not in line(0, 57).replace("\x1b[K", "")
