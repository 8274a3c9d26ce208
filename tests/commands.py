"""How the studies' command lines end, for the tests."""


def refusal(main, arguments, capsys):
    """What a command says to bad input; it must exit with 2 and without a traceback."""
    try:
        code = main(arguments)
    except SystemExit as stop:
        code = stop.code
    assert code == 2
    error = capsys.readouterr().err
    assert "Traceback" not in error
    return error
