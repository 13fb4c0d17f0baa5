"""Text of STEP files of simple solids, sheets and assemblies."""

import numpy as np

HEAD = """ISO-10303-21;
HEADER;
FILE_DESCRIPTION((''),'2;1');
FILE_NAME('','',(''),(''),'','','');
FILE_SCHEMA(('AUTOMOTIVE_DESIGN { 1 0 10303 214 1 1 1 1 }'));
ENDSEC;
DATA;
"""
Z = (0, 0, 1)


class StepFile:
    """Collects the entities of a STEP file; methods return a reference, such as #12.

    unit : prefix of the metre, '.MILLI.' for mm, or '$' for m
    """

    def __init__(self, unit='.MILLI.'):
        self.lines = []
        length = self.add(f'(LENGTH_UNIT()NAMED_UNIT(*)SI_UNIT({unit},.METRE.))')
        angle = self.add('(NAMED_UNIT(*)PLANE_ANGLE_UNIT()SI_UNIT($,.RADIAN.))')
        solid_angle = self.add('(NAMED_UNIT(*)SI_UNIT($,.STERADIAN.)SOLID_ANGLE_UNIT())')
        error = self.add(f"UNCERTAINTY_MEASURE_WITH_UNIT(LENGTH_MEASURE(1.E-07),{length},'','')")
        self.context = self.add(
            '(GEOMETRIC_REPRESENTATION_CONTEXT(3)GLOBAL_UNCERTAINTY_ASSIGNED_CONTEXT(('
            f'{error}))GLOBAL_UNIT_ASSIGNED_CONTEXT(({length},{angle},{solid_angle}))'
            "REPRESENTATION_CONTEXT('',''))"
        )
        application = self.add("APPLICATION_CONTEXT('automotive design')")
        self.add(
            "APPLICATION_PROTOCOL_DEFINITION('international standard','automotive_design',2000,"
            f'{application})'
        )
        self.product_context = self.add(f"PRODUCT_CONTEXT('',{application},'mechanical')")
        self.design = self.add(
            f"PRODUCT_DEFINITION_CONTEXT('part definition',{application},'design')"
        )

    def text(self):
        """Return the text of the file."""
        return HEAD + '\n'.join(self.lines) + '\nENDSEC;\nEND-ISO-10303-21;\n'

    def add(self, text):
        """Add an entity."""
        self.lines.append(f'#{len(self.lines) + 1}={text};')
        return f'#{len(self.lines)}'

    def solid(self, name, faces, *cavities):
        """Add a solid with the faces of its shell, and of cavities, which also face outward."""
        shell = self._shell('CLOSED_SHELL', faces)
        if not cavities:
            return self.add(f"MANIFOLD_SOLID_BREP('{name}',{shell})")
        voids = [
            self.add(f"ORIENTED_CLOSED_SHELL('',*,{self._shell('CLOSED_SHELL', inner)},.F.)")
            for inner in cavities
        ]
        return self.add(f"BREP_WITH_VOIDS('{name}',{shell},{_list(voids)})")

    def sheet(self, name, faces):
        """Add a surface that is not closed, such as a reference plane."""
        shell = self._shell('OPEN_SHELL', faces)
        return self.add(f"SHELL_BASED_SURFACE_MODEL('{name}',({shell}))")

    def wire(self, name, start, end):
        """Add a line that belongs to no solid."""
        line = self.add(f"POLYLINE('',({self.point(start)},{self.point(end)}))")
        return self.add(f"GEOMETRIC_CURVE_SET('{name}',({line}))")

    def polygons(self, corners, faces):
        """Add planar faces, lists of rows of the corners, seen from outside."""
        corners = np.asarray(corners, dtype=float)
        vertices = [self.add(f"VERTEX_POINT('',{self.point(c)})") for c in corners]
        edges = {}
        found = []
        for face in faces:
            loop = []
            for a, b in zip(face, [*face[1:], face[0]], strict=True):
                low, high = key = (min(a, b), max(a, b))
                if key not in edges:
                    line = self._line(corners[low], corners[high] - corners[low])
                    edges[key] = self.add(
                        f"EDGE_CURVE('',{vertices[low]},{vertices[high]},{line},.T.)"
                    )
                loop.append(self._oriented(edges[key], forward=(a, b) == key))
            one, two = corners[face[1]] - corners[face[0]], corners[face[2]] - corners[face[0]]
            plane = self.place(corners[face[0]], _unit(np.cross(one, two)), _unit(one))
            found.append(self._face([loop], self.add(f"PLANE('',{plane})")))
        return found

    def tube(self, radius, height, hole=0.0, turn=0.0):
        """Add the faces of a cylinder about z, with a round hole whose seam is turned (rad)."""
        circles, sides = [], []
        for r, x in ((radius, (1, 0, 0)), (hole, (np.cos(turn), np.sin(turn), 0))):
            if not r:
                continue
            ends = [r * np.array(x, dtype=float) + (0, 0, z) for z in (0, height)]
            vertices = [self.add(f"VERTEX_POINT('',{self.point(end)})") for end in ends]
            rims = []
            for vertex, z in zip(vertices, (0, height), strict=True):
                circle = self.add(f"CIRCLE('',{self.place((0, 0, z), Z, x)},{r:.9f})")
                rims.append(self.add(f"EDGE_CURVE('',{vertex},{vertex},{circle},.T.)"))
            seam = self._line(ends[0], np.array([0, 0, height]))
            seam = self.add(f"EDGE_CURVE('',{vertices[0]},{vertices[1]},{seam},.T.)")
            loop = [(rims[0], True), (seam, True), (rims[1], False), (seam, False)]
            surface = self.add(f"CYLINDRICAL_SURFACE('',{self.place((0, 0, 0), Z, x)},{r:.9f})")
            loop = [self._oriented(edge, forward=way) for edge, way in loop]
            sides.append(self._face([loop], surface, outward=r == radius))
            circles.append(rims)
        for k, z in enumerate((0, height)):
            loops = [
                [self._oriented(rims[k], forward=(k == 1) == (rims is circles[0]))]
                for rims in circles
            ]
            plane = self.place((0, 0, z), (0, 0, 2 * k - 1), (1, 0, 0))
            sides.append(self._face(loops, self.add(f"PLANE('',{plane})")))
        return sides

    def product(self, name, items, kind='ADVANCED_BREP_SHAPE_REPRESENTATION'):
        """Add a product with the items; returns what `assembly` needs of it."""
        origin = self.place((0, 0, 0), Z, (1, 0, 0))
        shape = self.add(f"{kind}('{name}',{_list([origin, *items])},{self.context})")
        product = self.add(f"PRODUCT('{name}','{name}','',({self.product_context}))")
        formation = self.add(f"PRODUCT_DEFINITION_FORMATION('','',{product})")
        definition = self.add(f"PRODUCT_DEFINITION('design','',{formation},{self.design})")
        place = self.add(f"PRODUCT_DEFINITION_SHAPE('','',{definition})")
        self.add(f'SHAPE_DEFINITION_REPRESENTATION({place},{shape})')
        return definition, shape, origin

    def assembly(self, name, parts):
        """Add a product of (name, product, position) of its parts, along the same axes."""
        places = [self.place(at, Z, (1, 0, 0)) for _, _, at in parts]
        whole, shape, origin = self.product(name, places, 'SHAPE_REPRESENTATION')
        for (instance, (definition, own, start), _), place in zip(parts, places, strict=True):
            use = self.add(
                f"NEXT_ASSEMBLY_USAGE_OCCURRENCE('{instance}','{instance}','',{whole},"
                f'{definition},$)'
            )
            use = self.add(f"PRODUCT_DEFINITION_SHAPE('Placement','',{use})")
            move = self.add(f"ITEM_DEFINED_TRANSFORMATION('','',{start},{place})")
            relation = self.add(
                f"(REPRESENTATION_RELATIONSHIP('','',{own},{shape})"
                f'REPRESENTATION_RELATIONSHIP_WITH_TRANSFORMATION({move})'
                'SHAPE_REPRESENTATION_RELATIONSHIP())'
            )
            self.add(f'CONTEXT_DEPENDENT_SHAPE_REPRESENTATION({relation},{use})')
        return whole, shape, origin

    def place(self, point, axis, direction):
        """Add a frame."""
        vectors = [self.add(f"DIRECTION('',{_numbers(v)})") for v in (axis, direction)]
        return self.add(f"AXIS2_PLACEMENT_3D('',{self.point(point)},{','.join(vectors)})")

    def point(self, xyz):
        """Add a point."""
        return self.add(f"CARTESIAN_POINT('',{_numbers(xyz)})")

    def _line(self, start, way):
        size = float(np.linalg.norm(way))
        vector = self.add(f"DIRECTION('',{_numbers(way / size)})")
        vector = self.add(f"VECTOR('',{vector},{size:.9f})")
        return self.add(f"LINE('',{self.point(start)},{vector})")

    def _oriented(self, edge, *, forward):
        return self.add(f"ORIENTED_EDGE('',*,*,{edge},{'.T.' if forward else '.F.'})")

    def _face(self, loops, surface, *, outward=True):
        loops = [self.add(f"EDGE_LOOP('',{_list(loop)})") for loop in loops]
        bounds = [
            self.add(f"FACE_{'' if k else 'OUTER_'}BOUND('',{loop},.T.)")
            for k, loop in enumerate(loops)
        ]
        sense = '.T.' if outward else '.F.'
        return self.add(f"ADVANCED_FACE('',{_list(bounds)},{surface},{sense})")

    def _shell(self, kind, faces):
        return self.add(f"{kind}('',{_list(faces)})")


def box_faces(sides, at=(0, 0, 0)):
    """Return the corners of a box and its sides, as `StepFile.polygons` takes them."""
    x, y, z = sides
    corners = [(i, j, k) for i in (0, x) for j in (0, y) for k in (0, z)]
    faces = [
        *([0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1]),
        *([2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]),
    ]
    return np.array(corners, dtype=float) + at, faces


def step_text(corners, faces, unit='.MILLI.'):
    """Return a STEP file of a solid with planar faces, lists of corners seen from outside."""
    file = StepFile(unit)
    file.product('part', [file.solid('', file.polygons(corners, faces))])
    return file.text()


def _list(references):
    return '(' + ','.join(references) + ')'


def _numbers(values):
    return '(' + ','.join(f'{float(v):.9f}' for v in values) + ')'


def _unit(vector):
    return vector / np.linalg.norm(vector)
