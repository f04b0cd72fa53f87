"""Settings of the stand-in; the folder of its data comes from the environment."""

import os
from pathlib import Path

DATA = Path(os.environ["HOST_DATA"])
MEDIA_ROOT = str(DATA / "media")
PAGES = os.environ.get("HOST_PAGES", "")
WORKERS_MAX_THREADS = 2
WORKERS_MAX_TIME_LIMIT = None

SECRET_KEY = "a stand-in has no secrets"  # noqa: S105
DEBUG = False
ALLOWED_HOSTS = ["*"]
ROOT_URLCONF = "webodm.urls"
USE_TZ = True
TIME_ZONE = "UTC"
DEFAULT_AUTO_FIELD = "django.db.models.AutoField"
DATA_UPLOAD_MAX_MEMORY_SIZE = 10_000_000
INSTALLED_APPS = [
    "django.contrib.auth",
    "django.contrib.contenttypes",
    "django.contrib.sessions",
    "app",
]
MIDDLEWARE = [
    "django.contrib.sessions.middleware.SessionMiddleware",
    "django.middleware.common.CommonMiddleware",
    "django.middleware.csrf.CsrfViewMiddleware",
    "django.contrib.auth.middleware.AuthenticationMiddleware",
]
AUTHENTICATION_BACKENDS = ["app.permissions.Backend"]
DATABASES = {
    "default": {
        "ENGINE": "webodm.database",
        "NAME": str(DATA / "db.sqlite3"),
        "OPTIONS": {"timeout": 20},
    }
}
TEMPLATES = []
REST_FRAMEWORK = {
    "DEFAULT_AUTHENTICATION_CLASSES": ["rest_framework.authentication.SessionAuthentication"],
    "DEFAULT_RENDERER_CLASSES": ["rest_framework.renderers.JSONRenderer"],
    "UNAUTHENTICATED_USER": "django.contrib.auth.models.AnonymousUser",
}
LOGGING_CONFIG = None
