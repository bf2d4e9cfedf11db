"""X.509 certificates with the library `cryptography`: an authority, and leaves signed by it.

Keys are ECDSA P-256. The router's certificate works only for a server, all others only for a
client, so that no client can pretend to be the router.
"""

from __future__ import annotations

import datetime as dt
import ipaddress
from collections.abc import Sequence
from dataclasses import dataclass

from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

CA_NAME = "helios-ca"
CA_DAYS = 3650
LEAF_DAYS = 365
BACKDATED = dt.timedelta(days=1)  # a robot's clock may be behind


@dataclass(frozen=True)
class KeyPair:
    """Certificate and its private key, each as PEM."""

    certificate: bytes
    key: bytes


def new_authority(days: int, now: dt.datetime) -> KeyPair:
    """Self-signed certificate of an authority that may sign leaves only; now: with time zone."""
    key = ec.generate_private_key(ec.SECP256R1())
    name = _name(CA_NAME)
    builder = (
        _builder(name, name, key.public_key(), now, now + dt.timedelta(days=days))
        .add_extension(x509.BasicConstraints(ca=True, path_length=0), critical=True)
        .add_extension(_usage(signs_certificates=True), critical=True)
        .add_extension(x509.SubjectKeyIdentifier.from_public_key(key.public_key()), critical=False)
    )
    return _pair(builder.sign(key, hashes.SHA256()), key)


def new_client(authority: KeyPair, name: str, days: int, now: dt.datetime) -> KeyPair:
    """Certificate of a client of the router."""
    return _leaf(authority, name, (name,), ExtendedKeyUsageOID.CLIENT_AUTH, days, now)


def new_router(
    authority: KeyPair, name: str, hosts: Sequence[str], days: int, now: dt.datetime
) -> KeyPair:
    """Certificate of the router; hosts: names and addresses that clients may use for it."""
    return _leaf(authority, name, hosts, ExtendedKeyUsageOID.SERVER_AUTH, days, now)


def expiry(certificate: bytes) -> dt.datetime:
    """End of validity of a PEM certificate, in UTC. Raises ValueError for other bytes."""
    return x509.load_pem_x509_certificate(certificate).not_valid_after_utc


def common_name(certificate: bytes) -> str:
    """Name in a PEM certificate. Raises ValueError for other bytes or without a name."""
    subject = x509.load_pem_x509_certificate(certificate).subject
    names = subject.get_attributes_for_oid(NameOID.COMMON_NAME)
    if not names:
        raise ValueError("the certificate has no name")
    return str(names[0].value)


def _leaf(
    authority: KeyPair,
    name: str,
    hosts: Sequence[str],
    purpose: x509.ObjectIdentifier,
    days: int,
    now: dt.datetime,
) -> KeyPair:
    """Signed certificate. It ends with the authority's at the latest.

    Raises ValueError if the authority's files are damaged or do not belong together.
    """
    issuer = x509.load_pem_x509_certificate(authority.certificate)
    signer = serialization.load_pem_private_key(authority.key, password=None)
    if not isinstance(signer, ec.EllipticCurvePrivateKey):
        raise ValueError("the key of the authority is not elliptic")
    if signer.public_key() != issuer.public_key():
        raise ValueError("ca.key is not the key of ca.pem")
    key = ec.generate_private_key(ec.SECP256R1())
    until = min(now + dt.timedelta(days=days), issuer.not_valid_after_utc)
    public = key.public_key()
    builder = (
        _builder(_name(name), issuer.subject, public, now, until)
        .add_extension(x509.BasicConstraints(ca=False, path_length=None), critical=True)
        .add_extension(_usage(signs_certificates=False), critical=True)
        .add_extension(x509.ExtendedKeyUsage([purpose]), critical=False)
        .add_extension(x509.SubjectAlternativeName([_host(h) for h in hosts]), critical=False)
        .add_extension(x509.SubjectKeyIdentifier.from_public_key(public), critical=False)
        .add_extension(
            x509.AuthorityKeyIdentifier.from_issuer_public_key(signer.public_key()), critical=False
        )
    )
    return _pair(builder.sign(signer, hashes.SHA256()), key)


def _builder(
    subject: x509.Name,
    issuer: x509.Name,
    public: ec.EllipticCurvePublicKey,
    now: dt.datetime,
    until: dt.datetime,
) -> x509.CertificateBuilder:
    return (
        x509.CertificateBuilder()
        .subject_name(subject)
        .issuer_name(issuer)
        .public_key(public)
        .serial_number(x509.random_serial_number())
        .not_valid_before(now - BACKDATED)
        .not_valid_after(until)
    )


def _usage(*, signs_certificates: bool) -> x509.KeyUsage:
    return x509.KeyUsage(
        digital_signature=not signs_certificates,
        key_cert_sign=signs_certificates,
        crl_sign=signs_certificates,
        content_commitment=False,
        key_encipherment=False,
        data_encipherment=False,
        key_agreement=False,
        encipher_only=False,
        decipher_only=False,
    )


def _name(common: str) -> x509.Name:
    return x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, common)])


def _host(host: str) -> x509.GeneralName:
    try:
        return x509.IPAddress(ipaddress.ip_address(host))
    except ValueError:
        return x509.DNSName(host)


def _pair(certificate: x509.Certificate, key: ec.EllipticCurvePrivateKey) -> KeyPair:
    pem = serialization.Encoding.PEM
    return KeyPair(
        certificate.public_bytes(pem),
        key.private_bytes(pem, serialization.PrivateFormat.PKCS8, serialization.NoEncryption()),
    )
