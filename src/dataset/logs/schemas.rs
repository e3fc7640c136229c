//! The types of the messages that are written, as the ROS 2 interface language has them, and their bytes in CDR.

/// A type of message.
#[derive(Debug)]
pub struct RosType {
    /// Its name.
    pub name: &'static str,
    fields: &'static str,
    /// The types of its fields, and theirs.
    parts: &'static [Part],
}

/// A type that is a part of others: its name and its fields.
type Part = (&'static str, &'static str);

const TIME: Part = ("builtin_interfaces/Time", "int32 sec\nuint32 nanosec\n");
const HEADER: Part = ("std_msgs/Header", "builtin_interfaces/Time stamp\nstring frame_id\n");
const VECTOR: Part = ("geometry_msgs/Vector3", "float64 x\nfloat64 y\nfloat64 z\n");
const WRENCH_PART: Part = ("geometry_msgs/Wrench", "geometry_msgs/Vector3 force\ngeometry_msgs/Vector3 torque\n");
const POINT_FIELD: Part = (
    "sensor_msgs/PointField",
    "uint8 INT8=1\nuint8 UINT8=2\nuint8 INT16=3\nuint8 UINT16=4\nuint8 INT32=5\nuint8 UINT32=6\nuint8 FLOAT32=7\n\
     uint8 FLOAT64=8\nstring name\nuint32 offset\nuint8 datatype\nuint32 count\n",
);

/// sensor_msgs/msg/Image.
pub const IMAGE: RosType = RosType {
    name: "sensor_msgs/msg/Image",
    fields: "std_msgs/Header header\nuint32 height\nuint32 width\nstring encoding\nuint8 is_bigendian\nuint32 step\n\
             uint8[] data\n",
    parts: &[HEADER, TIME],
};

/// geometry_msgs/msg/WrenchStamped.
pub const WRENCH: RosType = RosType {
    name: "geometry_msgs/msg/WrenchStamped",
    fields: "std_msgs/Header header\ngeometry_msgs/Wrench wrench\n",
    parts: &[HEADER, TIME, WRENCH_PART, VECTOR],
};

/// sensor_msgs/msg/PointCloud2.
pub const POINTS: RosType = RosType {
    name: "sensor_msgs/msg/PointCloud2",
    fields: "std_msgs/Header header\nuint32 height\nuint32 width\nsensor_msgs/PointField[] fields\nbool is_bigendian\n\
             uint32 point_step\nuint32 row_step\nuint8[] data\nbool is_dense\n",
    parts: &[HEADER, TIME, POINT_FIELD],
};

/// std_msgs/msg/String.
pub const TEXT: RosType = RosType { name: "std_msgs/msg/String", fields: "string data\n", parts: &[] };

impl RosType {
    /// Returns the definition of the type and of all types in it.
    pub fn definition(&self) -> String {
        let part = |(name, fields): &Part| format!("{}\nMSG: {name}\n{fields}", "=".repeat(80));
        std::iter::once(self.fields.to_owned()).chain(self.parts.iter().map(part)).collect()
    }
}

/// A message as it is written: CDR, little endian.
pub struct Cdr(Vec<u8>);

/// Bytes before the first field.
const HEAD: [u8; 4] = [0, 1, 0, 0];

impl Cdr {
    /// Begins a message.
    pub fn new() -> Self {
        Self(HEAD.to_vec())
    }

    /// Begins a message with the header of a frame at a time.
    pub fn with_header(stamp_ns: u64, frame: &str) -> Self {
        let mut cdr = Self::new();
        cdr.u32((stamp_ns / 1_000_000_000) as u32).u32((stamp_ns % 1_000_000_000) as u32).text(frame);
        cdr
    }

    /// Adds a number at a multiple of its size.
    fn number<const N: usize>(&mut self, bytes: [u8; N]) -> &mut Self {
        let at = self.0.len() - HEAD.len();
        self.0.resize(at.next_multiple_of(N) + HEAD.len(), 0);
        self.0.extend(bytes);
        self
    }

    /// Adds a byte.
    pub fn u8(&mut self, value: u8) -> &mut Self {
        self.number([value])
    }

    /// Adds a whole number.
    pub fn u32(&mut self, value: u32) -> &mut Self {
        self.number(value.to_le_bytes())
    }

    /// Adds a float.
    pub fn f64(&mut self, value: f64) -> &mut Self {
        self.number(value.to_le_bytes())
    }

    /// Adds a text.
    pub fn text(&mut self, text: &str) -> &mut Self {
        self.u32(text.len() as u32 + 1);
        self.0.extend(text.as_bytes());
        self.u8(0)
    }

    /// Adds a list of bytes.
    pub fn bytes(&mut self, bytes: &[u8]) -> &mut Self {
        self.u32(bytes.len() as u32);
        self.0.extend(bytes);
        self
    }

    /// Returns the bytes of the message.
    pub fn into_bytes(self) -> Vec<u8> {
        self.0
    }
}

impl Default for Cdr {
    fn default() -> Self {
        Self::new()
    }
}
