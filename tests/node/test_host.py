from tests.node import host

LISTING = """\
:env:.cert='/from/environment.crt'
global.cert='/from/file.crt'
global.index-url='https://index.example/simple?a=b'
"""


def test_pips_environment_overrides_its_files():
    assert host.pip_settings(LISTING)["cert"] == "/from/environment.crt"


def test_pip_values_may_contain_an_equals_sign():
    assert host.pip_settings(LISTING)["index-url"] == "https://index.example/simple?a=b"


def test_pip_configuration_moves_the_cache_to_the_mounted_folder():
    text = host.pip_configuration({"cache-dir": "/elsewhere", "timeout": "9%"})
    assert f"cache-dir = {host.PIP_CACHE_IN_IMAGE}" in text
    assert "timeout = 9%" in text


def test_only_apts_network_settings_are_taken():
    dump = 'APT "";\nAcquire::http "";\nAcquire::http::Proxy "http://proxy.example";\nDir "/";\n'
    assert host.apt_settings(dump) == ['Acquire::http::Proxy "http://proxy.example";']


def test_files_that_settings_name_are_found(tmp_path):
    bundle = tmp_path / "ca.crt"
    bundle.touch()
    values = [f'Acquire::https::CaInfo "{bundle}";', f"{tmp_path} /does/not/exist", "https://index.example"]
    assert host.named_paths(values) == {bundle, tmp_path}
