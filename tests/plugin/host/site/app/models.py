"""Projects and tasks with the members that a plugin may use."""

import json
import os
import re
import uuid
from typing import ClassVar

from django.conf import settings
from django.db import models
from django.utils import timezone


class Project(models.Model):
    """A project of one owner."""

    owner = models.ForeignKey("auth.User", on_delete=models.CASCADE)
    name = models.CharField(max_length=255)
    public = models.BooleanField(default=False)
    deleting = models.BooleanField(default=False)


class Right(models.Model):
    """What a user may do with a project."""

    project = models.ForeignKey(Project, on_delete=models.CASCADE)
    user = models.ForeignKey("auth.User", on_delete=models.CASCADE)
    right = models.CharField(max_length=40)


class PluginDatum(models.Model):
    """A value that a plugin keeps."""

    key = models.CharField(max_length=255)
    user = models.ForeignKey("auth.User", null=True, on_delete=models.CASCADE)
    json_text = models.TextField(default="null")


class Geometry:
    """A crop: its own coordinates are x, y, its GeoJSON is not."""

    def __init__(self, wkt):
        self.wkt = wkt
        self.geom_type = "Polygon"
        rings = re.findall(r"\(([^()]+)\)", wkt)
        self.coords = tuple(
            tuple(tuple(float(v) for v in pair.split()) for pair in ring.split(","))
            for ring in rings
        )

    @property
    def num_coords(self):
        """The number of corners."""
        return sum(map(len, self.coords))

    @property
    def geojson(self):
        """Latitude first: the trap is kept."""
        rings = [[[y, x] for x, y in ring] for ring in self.coords]
        return json.dumps({"type": "Polygon", "coordinates": rings})


class Task(models.Model):
    """A task whose assets are files below the media folder."""

    ASSETS: ClassVar = {
        "georeferenced_model.laz": "odm_georeferencing/odm_georeferenced_model.laz",
        "georeferenced_model.las": "odm_georeferencing/odm_georeferenced_model.las",
        "dsm.tif": "odm_dem/dsm.tif",
        "shots.geojson": "odm_report/shots.geojson",
    }

    id = models.UUIDField(primary_key=True, default=uuid.uuid4)
    project = models.ForeignKey(Project, on_delete=models.CASCADE)
    name = models.CharField(max_length=255, null=True)
    status = models.IntegerField(null=True, default=40)
    public = models.BooleanField(default=False)
    epsg = models.IntegerField(null=True)
    wkt = models.TextField(null=True)
    created_at = models.DateTimeField(default=timezone.now)
    size = models.FloatField(default=0.0)
    crop_wkt = models.TextField(default="")
    extent_text = models.TextField(default="null")
    points = models.IntegerField(null=True)

    @property
    def crop(self):
        """The crop as a geometry."""
        return Geometry(self.crop_wkt) if self.crop_wkt else None

    @property
    def available_assets(self):
        """Names of the assets that are there."""
        return [name for name in self.ASSETS if os.path.exists(self.get_asset_download_path(name))]

    def task_path(self, *args):
        """Return the task's folder, or a place in it."""
        folder = os.path.join(
            settings.MEDIA_ROOT, "project", str(self.project_id), "task", str(self.id)
        )
        return os.path.join(folder, *args)

    def assets_path(self, *args):
        """Return the folder of assets, or a place in it."""
        return self.task_path("assets", *args)

    def get_asset_download_path(self, asset):
        """Return the path of an asset, which need not exist."""
        return self.assets_path(self.ASSETS[asset])

    def get_extent(self):
        """Return west, south, east, north."""
        found = json.loads(self.extent_text)
        return None if found is None else tuple(found)

    def get_statistics(self):
        """Return what is known of the cloud, without a doubt in the file that says it."""
        path = self.assets_path("odm_report", "stats.json")
        points = self.points
        if os.path.exists(path):
            with open(path, encoding="utf-8") as file:
                found = json.load(file)
            points = found.get("reconstruction_statistics", {}).get("reconstructed_points_count")
        return {"pointcloud": {"points": points}}

    def update_size(self):
        """Add up the files, in megabytes."""
        total = 0
        for folder, _, names in os.walk(self.task_path()):
            total += sum(os.path.getsize(os.path.join(folder, name)) for name in names)
        self.size = total / 1024 / 1024
        self.save()
