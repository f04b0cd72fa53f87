"""Rights on projects: its owner has all of them, others what a row gives."""

from django.contrib.auth.backends import ModelBackend


class Backend(ModelBackend):
    """Answers has_perm(right, project)."""

    def has_perm(self, user, perm, obj=None):
        """Whether a user has a right on a project."""
        from app.models import Right

        if obj is None or not user.is_authenticated:
            return False
        if obj.owner_id == user.pk:
            return True
        return Right.objects.filter(project=obj, user=user, right=perm).exists()
