"""Certificates for a site: an authority of its own, and one for each router, rig and person.

    python deploy/certificates.py tls --host router.site --host 10.0.0.1 router rig anna ben

writes `authority.pem` and, for each name, `NAME.pem` and `NAME.key` to the folder `tls`. Run again with other
names, it takes the authority that is there. `authority.key` signs whatever is asked of it: keep it where only
you can read it, and not on the rig. Needs `cryptography` (`pip install cryptography`).
"""

import argparse
import ipaddress
import os
import sys
from datetime import UTC, datetime, timedelta
from pathlib import Path

try:
    from cryptography import x509
    from cryptography.hazmat.primitives import hashes, serialization
    from cryptography.hazmat.primitives.asymmetric import ec
    from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID
except ImportError:
    sys.exit("error: needs the library cryptography: pip install cryptography")

AUTHORITY = "authority"
BACKDATED = timedelta(hours=1)
"""For hosts whose clocks are behind."""


def main() -> None:
    options = parsed()
    options.folder.mkdir(parents=True, exist_ok=True)
    authority, key = the_authority(options.folder, options.days)
    for name in options.names:
        own = ec.generate_private_key(ec.SECP256R1())
        certificate = (
            begun(name, authority.subject, own.public_key(), options.days)
            .add_extension(x509.BasicConstraints(ca=False, path_length=None), critical=True)
            .add_extension(x509.SubjectAlternativeName(alternatives(options.hosts)), critical=False)
            .add_extension(
                x509.ExtendedKeyUsage([ExtendedKeyUsageOID.SERVER_AUTH, ExtendedKeyUsageOID.CLIENT_AUTH]),
                critical=False,
            )
            .add_extension(
                x509.AuthorityKeyIdentifier.from_issuer_public_key(key.public_key()), critical=False
            )
            .sign(key, hashes.SHA256())
        )
        write(options.folder, name, certificate, own)
        until = f"{certificate.not_valid_after_utc:%Y-%m-%d}"
        print(f"wrote {options.folder / name}.pem and .key, good until {until}")


def parsed() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folder", type=Path, help="where the files go")
    parser.add_argument("names", nargs="+", metavar="NAME", help="common name, as the access rules have it")
    parser.add_argument(
        "--host",
        action="append",
        dest="hosts",
        help="name or address by which whoever listens is reached; localhost and 127.0.0.1 unless given",
    )
    parser.add_argument("--days", type=int, default=825, help="how long they are good (825)")
    options = parser.parse_args()
    options.hosts = options.hosts or ["localhost", "127.0.0.1"]
    for name in options.names:
        if name == AUTHORITY or not name.replace("-", "").replace("_", "").isalnum():
            parser.error(f"{name!r} is no name: expected letters, digits, - and _, and not {AUTHORITY!r}")
        if (options.folder / f"{name}.key").exists():
            parser.error(f"{options.folder / name}.key is there already: delete it to have a new one")
    return options


def the_authority(folder: Path, days: int) -> tuple[x509.Certificate, ec.EllipticCurvePrivateKey]:
    """The site's own authority, made where there is none."""
    if (folder / f"{AUTHORITY}.key").exists():
        key = serialization.load_pem_private_key((folder / f"{AUTHORITY}.key").read_bytes(), None)
        if not isinstance(key, ec.EllipticCurvePrivateKey):
            sys.exit(f"error: {folder / AUTHORITY}.key is not of this script")
        return x509.load_pem_x509_certificate((folder / f"{AUTHORITY}.pem").read_bytes()), key
    key = ec.generate_private_key(ec.SECP256R1())
    name = common_name("lidarboost site authority")
    certificate = (
        begun("lidarboost site authority", name, key.public_key(), 2 * days)
        .add_extension(x509.BasicConstraints(ca=True, path_length=0), critical=True)
        .add_extension(x509.SubjectKeyIdentifier.from_public_key(key.public_key()), critical=False)
        .sign(key, hashes.SHA256())
    )
    write(folder, AUTHORITY, certificate, key)
    return certificate, key


def begun(
    name: str, issuer: x509.Name, public: ec.EllipticCurvePublicKey, days: int
) -> x509.CertificateBuilder:
    now = datetime.now(UTC)
    return (
        x509.CertificateBuilder()
        .subject_name(common_name(name))
        .issuer_name(issuer)
        .public_key(public)
        .serial_number(x509.random_serial_number())
        .not_valid_before(now - BACKDATED)
        .not_valid_after(now + timedelta(days=days))
    )


def common_name(name: str) -> x509.Name:
    return x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, name)])


def alternatives(hosts: list[str]) -> list[x509.GeneralName]:
    """Host names and addresses, each as what it is."""
    found: list[x509.GeneralName] = []
    for host in hosts:
        try:
            found.append(x509.IPAddress(ipaddress.ip_address(host)))
        except ValueError:
            found.append(x509.DNSName(host))
    return found


def write(folder: Path, name: str, certificate: x509.Certificate, key: ec.EllipticCurvePrivateKey) -> None:
    """The key first, readable by its owner alone from the first byte on."""
    pem = key.private_bytes(
        serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, serialization.NoEncryption()
    )
    descriptor = os.open(folder / f"{name}.key", os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
    with os.fdopen(descriptor, "wb") as file:
        file.write(pem)
    (folder / f"{name}.pem").write_bytes(certificate.public_bytes(serialization.Encoding.PEM))


if __name__ == "__main__":
    main()
