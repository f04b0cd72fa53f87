"""Views on one task."""

from django.core.exceptions import ObjectDoesNotExist, ValidationError
from django.http import JsonResponse
from rest_framework import exceptions
from rest_framework.permissions import AllowAny
from rest_framework.views import APIView

from app import models

from .common import check_project_perms


class TaskNestedView(APIView):
    """A view below a task."""

    queryset = models.Task.objects.all().select_related("project")
    permission_classes = (AllowAny,)

    def get_and_check_task(self, request, pk, annotate=None):
        """Return a task that the visitor may see; public ones are everyone's."""
        try:
            task = self.queryset.annotate(**(annotate or {})).get(pk=pk)
        except (ObjectDoesNotExist, ValidationError):
            raise exceptions.NotFound from None
        if not (task.public or task.project.public):
            check_project_perms(request, task.project)
        return task


class _Detail(TaskNestedView):
    def get(self, request, project=None, pk=None):
        task = self.get_and_check_task(request, pk)
        return JsonResponse(
            {
                "id": str(task.id),
                "project": task.project_id,
                "name": task.name,
                "status": task.status,
                "public": task.public,
                "epsg": task.epsg,
                "wkt": task.wkt,
                "extent": task.get_extent(),
                "available_assets": task.available_assets,
                "created_at": task.created_at.isoformat(),
                "size": task.size,
                "statistics": task.get_statistics(),
            }
        )


task_detail = _Detail.as_view()
