"""Rights on a project, checked as WebODM does."""

from rest_framework import exceptions


def check_project_perms(request, project, perms=("view_project",)):
    """Refuse as not found."""
    for perm in perms:
        if not request.user.has_perm(perm, project):
            raise exceptions.NotFound
