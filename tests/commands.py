"""Exit of the studies' command lines, for the tests."""


def refusal(main, arguments, capsys):
    """Error message of a command for bad input; it must exit with 2 and without a traceback."""
    try:
        code = main(arguments)
    except SystemExit as stop:
        code = stop.code
    assert code == 2
    error = capsys.readouterr().err
    assert "Traceback" not in error
    return error
