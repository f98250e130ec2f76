"""The reference of the command line is that of the parser."""

import re

from scripts.documentation.commands import CODES, PAGE, commands_page
from slidax.cli import app

TEXT = PAGE.read_text(encoding="utf-8")


def test_the_page_of_commands_is_up_to_date():
    assert commands_page() == TEXT, "run `.venv/bin/python scripts/build-site --commands`"


def test_every_command_and_the_main_options_of_run_are_on_the_commands_page():
    named = [command.name or command.callback.__name__ for command in app.registered_commands]
    assert len(named) > 15
    for name in named:
        assert f"\n## slidax {name}\n" in TEXT, name
    section = TEXT.partition("\n## slidax run\n")[2].partition("\n## ")[0]
    for option in ("--set PATH=VALUE", "--json", "--engine auto\\|native\\|xla\\|cuda", "--record FILE.html", "--long"):
        assert f"`{option}`" in section, option


def test_exit_codes_in_help_texts_and_in_the_table_are_the_same():
    stated = {
        int(code)
        for line in re.findall(r"^Exit code (.*?)\n\n", TEXT, re.MULTILINE | re.DOTALL)
        for code in re.findall(r"(?:^|; )(\d+)[:,]", line.replace("\n", " "))
    }
    assert stated == set(CODES) - {1}
